// Draws the page of `twinrate report` from the JSON in #content (report/parts.hpp says what it holds).
'use strict';

const STROKES = {
  true: { stroke: '#b4bcc4', width: 3.5 },
  hat: { stroke: '#0b5cab', width: 1.3 },
  ref: { stroke: '#1c2126', width: 1.2, dash: [6, 4] },
  true2: { stroke: '#f0c9a4', width: 3.5 },
  hat2: { stroke: '#c2500a', width: 1.3 },
  ref2: { stroke: '#7a3d12', width: 1.2, dash: [2, 3] },
  lost: { stroke: '#b3261e', width: 1.1 },
  fit: { stroke: '#1c2126', width: 2 },
  dots0: { stroke: '#b4bcc4', width: 0, dots: true },
  dots: { stroke: '#0b5cab', width: 0, dots: true },
  dots2: { stroke: '#e07b1a', width: 0, dots: true },
  run0: { stroke: '#0b5cab', width: 1.5 },
  run1: { stroke: '#c2500a', width: 1.5 },
  run2: { stroke: '#1d7a46', width: 1.5 },
  run3: { stroke: '#7b3fa0', width: 1.5 },
  run4: { stroke: '#b3912a', width: 1.5 },
  run5: { stroke: '#2a9db3', width: 1.5 },
  run6: { stroke: '#b3266e', width: 1.5 },
  run7: { stroke: '#5b6670', width: 1.5 },
};
const GRID = { stroke: '#eceff2', width: 1 };
const FONT = '12px system-ui, "Segoe UI", "DejaVu Sans", sans-serif';
const LABELLED_BARS = 8;
const SMALL_HEIGHT = 180, LABELLED_HEIGHT = 340;
const charts = [];

function element(tag, properties = {}, children = []) {
  const node = Object.assign(document.createElement(tag), properties);
  node.append(...children);
  return node;
}

function shown(value) {
  return value == null ? '' : String(Number(value.toPrecision(4)));
}

// uPlot's own tick labels round small numbers to 0.
function tickLabels(chart, splits) {
  const step = Math.abs(splits[1] - splits[0]) || 1;
  return splits.map((v) => (Math.abs(v) < step / 1e6 ? '0' : String(Number(v.toPrecision(5)))));
}

// Only powers of ten are labelled on a logarithmic axis.
function decadeLabels(chart, splits) {
  const decade = (v) => Math.abs(Math.log10(v) - Math.round(Math.log10(v))) < 1e-6;
  return splits.map((v) => (v > 0 && decade(v) ? String(Number(v.toPrecision(2))) : ''));
}

function axis(label, size) {
  return { label, values: tickLabels, labelFont: FONT, font: FONT, grid: GRID, ticks: GRID, stroke: '#3c454d', labelSize: 20, size };
}

// All figures of a group have the same zoom.
function shareZoom(group) {
  let passing = false;
  return (chart, scale) => {
    if (scale !== 'x' || !group || passing) return;
    passing = true;
    const { min, max } = chart.scales.x;
    for (const other of charts) {
      if (other.group === group && other.chart !== chart) other.chart.setScale('x', { min, max });
    }
    passing = false;
  };
}

// A dashed line across the plot: vertical at a mark's x, horizontal at a level's y.
function drawLine(line) {
  return (chart) => {
    const { ctx, bbox } = chart, vertical = 'x' in line;
    const at = vertical ? chart.valToPos(line.x, 'x', true) : chart.valToPos(line.y, 'y', true);
    const [begin, length] = vertical ? [bbox.left, bbox.width] : [bbox.top, bbox.height];
    if (at < begin || at > begin + length) return;
    ctx.save();
    ctx.strokeStyle = ctx.fillStyle = '#b3261e';
    ctx.lineWidth = devicePixelRatio;
    ctx.setLineDash([4 * devicePixelRatio, 3 * devicePixelRatio]);
    ctx.beginPath();
    ctx.moveTo(vertical ? at : bbox.left, vertical ? bbox.top : at);
    ctx.lineTo(vertical ? at : bbox.left + bbox.width, vertical ? bbox.top + bbox.height : at);
    ctx.stroke();
    ctx.font = `${12 * devicePixelRatio}px sans-serif`;
    ctx.textAlign = vertical ? 'left' : 'right';
    ctx.fillText(line.text, vertical ? at + 4 * devicePixelRatio : bbox.left + bbox.width - 4 * devicePixelRatio,
                 vertical ? bbox.top + 13 * devicePixelRatio : at - 4 * devicePixelRatio);
    ctx.restore();
  };
}

// Shades intervals of x.
function shade(stretches) {
  return (chart) => {
    const { ctx, bbox } = chart;
    ctx.save();
    ctx.fillStyle = '#fdf1e2';
    for (const [from, to] of stretches) {
      const left = Math.max(chart.valToPos(from, 'x', true), bbox.left);
      const right = Math.min(chart.valToPos(to, 'x', true), bbox.left + bbox.width);
      if (right > left) ctx.fillRect(left, bbox.top, right - left, bbox.height);
    }
    ctx.restore();
  };
}

function errorBars(figure, curve) {
  return (chart) => {
    const { ctx } = chart;
    ctx.save();
    ctx.beginPath();
    ctx.rect(chart.bbox.left, chart.bbox.top, chart.bbox.width, chart.bbox.height);
    ctx.clip();
    ctx.strokeStyle = STROKES[curve.role].stroke;
    ctx.lineWidth = devicePixelRatio;
    curve.errors.forEach((error, i) => {
      if (error == null || curve.values[i] == null) return;
      const x = chart.valToPos(figure.x[i], 'x', true);
      ctx.beginPath();
      ctx.moveTo(x, chart.valToPos(curve.values[i] - error, 'y', true));
      ctx.lineTo(x, chart.valToPos(curve.values[i] + error, 'y', true));
      ctx.stroke();
    });
    ctx.restore();
  };
}

// The given labels, upright; without any, the x of the largest bars.
function barLabels(figure) {
  const amplitude = figure.series[0].values;
  if (figure.bar_labels) return figure.bar_labels.map(({ x, text }) => ({ i: figure.x.indexOf(x), text }));
  const largest = Math.max(...amplitude);
  return amplitude.map((value, i) => i).filter((i) => amplitude[i] > 0.04 * largest)
    .sort((a, b) => amplitude[b] - amplitude[a]).slice(0, LABELLED_BARS)
    .map((i) => ({ i, text: figure.x[i] }));
}

// Splits a long label at the '+' nearest to its middle.

function inTwoLines(text) {
  const parts = [...text.matchAll(/\+/g)].map((match) => match.index);
  if (text.length < 22 || !parts.length) return [text];
  const at = parts.reduce((best, i) => (Math.abs(i - text.length / 2) < Math.abs(best - text.length / 2) ? i : best));
  return [text.slice(0, at), text.slice(at)];
}

function labelBars(figure) {
  const labels = barLabels(figure), upright = Boolean(figure.bar_labels);
  return (chart) => {
    const { ctx } = chart, placed = [];
    for (const { i, text } of labels) {
      ctx.save();
      ctx.font = `${12 * devicePixelRatio}px sans-serif`;
      const box = { x: chart.valToPos(figure.x[i], 'x', true), y: chart.valToPos(figure.series[0].values[i], 'y', true), width: ctx.measureText(text).width };
      const hides = (p) => Math.abs(p.x - box.x) < (p.width + box.width) / 2 + 2 && Math.abs(p.y - box.y) < 13 * devicePixelRatio;
      if (!upright && placed.some(hides)) {  // the label of a higher bar stands there
        ctx.restore();
        continue;
      }
      placed.push(box);
      ctx.fillStyle = '#1c2126';
      ctx.textAlign = upright ? 'left' : 'center';
      ctx.textBaseline = upright ? 'middle' : 'alphabetic';
      ctx.translate(box.x, box.y - 5 * devicePixelRatio);
      if (upright) ctx.rotate(-Math.PI / 2);
      const lines = upright ? inTwoLines(text) : [text];
      lines.forEach((line, i) => ctx.fillText(line, 0, (i - (lines.length - 1) / 2) * 13 * devicePixelRatio));
      ctx.restore();
    }
  };
}

function seriesOptions(figure, curve) {
  const options = { label: curve.name, points: { show: false }, value: (chart, v) => shown(v),
                    ...(STROKES[curve.role] || STROKES.hat) };
  if (figure.bars) {
    return { ...options, width: 0, fill: options.stroke, paths: uPlot.paths.bars({ size: [0.6, 40, 1] }) };
  }
  if (options.dots) return { ...options, paths: () => null, points: { show: true, size: 5, width: 1, fill: options.stroke } };
  if (curve.stepped) options.paths = uPlot.paths.stepped({ align: 1 });
  options.spanGaps = figure.group.startsWith('overlay');
  return options;
}

function yRange(figure) {
  if (figure.y_range) return figure.y_range;
  if (figure.log_y) return (chart, min, max) => (min > 0 ? [min / 1.3, max * 1.6] : [1e-6, 1]);
  const room = figure.bar_labels ? 2.2 : 1.15;  // above the bars
  if (figure.bars) return (chart, min, max) => [0, max > 0 ? room * max : 1];
  return (chart, min, max) => {
    if (min == null) return [0, 1];
    const margin = Math.max(0.06 * (max - min), 1e-9 + 0.01 * Math.max(Math.abs(min), Math.abs(max)));
    return [min - margin, max + margin];
  };
}

function draw(figure, box) {
  const hooks = { setScale: [shareZoom(figure.group)], drawClear: [], draw: [] };
  if (figure.shaded) hooks.drawClear.push(shade(figure.shaded));
  for (const curve of figure.series) if (curve.errors) hooks.draw.push(errorBars(figure, curve));
  for (const line of figure.marks || []) hooks.draw.push(drawLine(line));
  if (figure.level) hooks.draw.push(drawLine(figure.level));
  if (figure.bars) hooks.draw.push(labelBars(figure));
  const x = figure.bars ? { time: false, range: (chart, min, max) => [min - 0.7, max + 0.7] } : { time: false };
  const degrees = figure.y_range && figure.y_range[1] - figure.y_range[0] === 360;
  const chart = new uPlot({
    width: box.clientWidth,
    height: box.dataset.height * 1,
    scales: { x, y: { range: yRange(figure), ...(figure.log_y ? { distr: 3 } : {}) } },
    axes: [axis(figure.x_label, 34),
           { ...axis(figure.y_label, 68), ...(degrees ? { incrs: [30, 45, 90, 180] } : {}),
             ...(figure.log_y ? { values: decadeLabels } : {}) }],
    series: [{ label: figure.x_label, value: (u, v) => (v == null ? '' : String(Number(v.toPrecision(6)))) },
             ...figure.series.map((curve) => seriesOptions(figure, curve))],
    legend: { show: !box.dataset.small },
    cursor: { drag: { x: true, y: false }, points: { size: 6 },
              sync: figure.group ? { key: figure.group, setSeries: false } : undefined },
    hooks,
  }, [figure.x, ...figure.series.map((curve) => curve.values)], box);
  charts.push({ chart, box, group: figure.group });
}

function figureNode(figure, height) {
  const box = element('div', { className: 'chart' });
  box.dataset.height = height;
  if (height === SMALL_HEIGHT) box.dataset.small = 1;
  const node = element('figure', {}, [element('h3', { textContent: figure.title }), box]);
  if (figure.note) node.append(element('figcaption', { textContent: figure.note }));
  return { node, draw: () => draw(figure, box) };
}

function sectionNode(section) {
  const height = section.columns === 3 ? SMALL_HEIGHT : 230;
  const figures = (section.figures || []).map((figure) => figureNode(figure, figure.bar_labels ? LABELLED_HEIGHT : height));
  const node = element('section', {}, [
    element('h2', { textContent: section.heading }),
    element('p', { className: 'note', textContent: section.note }),
    element('div', { className: `figures columns-${section.columns}` }, figures.map((f) => f.node)),
    ...(section.table && section.table.rows.length ? [tableNode(section.table.head, section.table.rows)] : []),
  ]);
  return { node, draw: () => figures.forEach((f) => f.draw()) };
}

function tableNode(head, rows) {
  const cell = (text) => {
    const verdict = /^(locked|lost|tripped)\b/.exec(text);
    return element('td', { textContent: text, className: verdict ? verdict[1] : '' });
  };
  return element('div', { className: 'table' }, [element('table', { className: 'plain' }, [
    element('thead', {}, [element('tr', {}, head.map((text) => element('th', { textContent: text })))]),
    element('tbody', {}, rows.map((row) => element('tr', {}, row.map(cell)))),
  ])]);
}

function verdictNode(verdict) {
  return element('div', { className: `verdict ${verdict.state}` },
    [element('strong', { textContent: verdict.headline }), verdict.text]);
}

function summaryNode(rows) {
  return element('dl', { className: 'summary' }, rows.map(([quantity, value]) => element('div', {},
    [element('dt', { textContent: quantity }), element('dd', { textContent: value })])));
}

function eventNodes(events) {
  const body = events.length
    ? tableNode(['t, s', 'process', 'reason', 'text'], events)
    : element('p', { className: 'empty', textContent: 'None.' });
  return [element('h2', { textContent: 'Events' }), body];
}

function configNode(config, title) {
  return element('details', {}, [element('summary', { textContent: title || 'Resolved config' }),
                                 element('pre', { textContent: config })]);
}

function fit() {
  for (const { chart, box } of charts) {
    if (box.clientWidth > 0 && box.clientWidth !== chart.width) {
      chart.setSize({ width: box.clientWidth, height: chart.height });
    }
  }
}

function build(content) {
  const page = document.getElementById('page');
  const revision = content.revision ? ` - twinrate ${content.revision}` : '';
  page.replaceChildren(element('h1', { textContent: content.title }),
    element('p', { className: 'subtitle', textContent: content.subtitle + revision }));
  if (content.command) page.append(element('p', { className: 'subtitle', textContent: content.command }));
  for (const note of content.notes || []) page.append(element('p', { className: 'note', textContent: note }));
  if (content.verdict) page.append(verdictNode(content.verdict));
  if (content.summary) page.append(summaryNode(content.summary));
  if (content.comparison) page.append(tableNode(content.comparison.head, content.comparison.rows));
  const sections = content.sections.map(sectionNode);
  page.append(...sections.map((section) => section.node));
  if (content.events) page.append(...eventNodes(content.events));
  if (content.config) page.append(configNode(content.config, content.config_title));
  sections.forEach((section) => section.draw());
  addEventListener('resize', fit);
  addEventListener('beforeprint', fit);
}

build(JSON.parse(document.getElementById('content').textContent));

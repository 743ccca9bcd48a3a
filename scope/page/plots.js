// The plots over time: charts, chips, drag and drop, zoom, cursors, marks, ghosts.
import { byId, element, save, shown } from './dom.js';
import { feed } from './feed.js';
import { drawOther, OTHER_KINDS } from './other_axes.js';
import { follow, origin, range, show, state, shortName, T_s, tell, unitOf } from './state.js';
import { dragLevel, levelOf } from './trigger.js';

const COLOURS = ['#0b5cab', '#c2500a', '#1d7a46', '#7b3fa0', '#a3222f', '#00798c', '#8a6d00', '#5b6670'];
const HEIGHT = 168;
const charts = new Map();  // plot -> {uplot, chips, node}
let dragged = null, pressed = null;  // a plot that is moved; the chart that the pointer went down on

// The truth is wide and pale, a reference is dashed, the estimate is in full: in every plot.
export function style(plot, index) {
  const name = plot.signals[index].name;
  const hue = /i_d|u_d/.test(name) ? 0 : /i_q|u_q/.test(name) ? 1 : -1;
  if (name === 'truth.T_load_Nm') return { stroke: '#5b6670', width: 2 };
  if (/^truth\./.test(name)) return { stroke: ['#a8c6e6', '#f0c9a4'][hue] ?? (index < 2 ? '#b4bcc4' : '#b9d8c4'), width: 3.5 };
  if (/_ref_|u_limit/.test(name)) return { stroke: ['#0b3f75', '#7a3d12'][hue] ?? '#1c2126', width: 1.3, dash: [6, 4] };
  if (hue >= 0) return { stroke: COLOURS[hue], width: 1.4 };
  const own = plot.signals.slice(0, index).filter((s) => !/^truth\.|_ref_|i_d|i_q|u_d|u_q/.test(s.name)).length;
  return { stroke: COLOURS[(own + (hue === -1 && plot.signals.some((s) => /u_d/.test(s.name)) ? 2 : 0)) % COLOURS.length], width: 1.4 };
}

// A ghost has the colour of its signal, darker where that is pale.
const PALE = { '#b4bcc4': '#7d8790', '#a8c6e6': '#5f93c9', '#f0c9a4': '#d38f55', '#b9d8c4': '#6ba583' };
const ghostColour = (stroke) => PALE[stroke] ?? `${stroke}b0`;
// On other axes than time a curve is thin: nothing pale.
export const colourOf = (plot, index) => { const { stroke } = style(plot, index); return PALE[stroke] ?? stroke; };

const changed = () => tell('layout');

export function remove(plot, index) {
  plot.signals.splice(index, 1);
  changed();
}

export function add(name, place = state.active, axis = 'l') {
  const plots = state.layout.plots;
  if (!plots[place] || plots[place].kind !== 'time') {
    plots.unshift({ kind: 'time', signals: [] });
    place = state.active = 0;
  }
  const plot = plots[place];
  delete plot.fill;
  if (!plot.signals.some((s) => s.name === name)) plot.signals.push({ name, axis });
  changed();
}

function chip(plot, index) {
  const s = plot.signals[index], look = style(plot, index);
  const line = element('i', { className: look.dash ? 'dash' : '' });
  line.style.borderColor = plot.kind === 'time' ? look.stroke : colourOf(plot, index);
  const isX = plot.kind === 'xy' && index === 0;
  if (isX) line.style.visibility = 'hidden';
  const side = element('b', { title: `${s.name}: left or right axis` }, (isX ? 'x: ' : '') + shortName(s.name) + (s.axis === 'r' ? ' ▸' : ''));
  side.onclick = () => { s.axis = s.axis === 'r' ? 'l' : 'r'; changed(); };
  const away = element('button', { className: 'x', title: `remove ${s.name}` }, '×');
  away.onclick = () => remove(plot, index);
  return element('span', { className: 'chip' }, line, side, away);
}

function split(plot) {
  const plots = state.layout.plots, place = plots.indexOf(plot);
  plots.splice(place, 1, ...plot.signals.map((s) => ({ kind: 'time', signals: [{ ...s, axis: 'l' }] })));
  changed();
}

function bar(plot) {
  const plots = state.layout.plots;
  const kind = element('select', { title: 'axes of this plot' }, ...Object.entries(OTHER_KINDS).map(([value, label]) => element('option', { value, selected: plot.kind === value }, label)));
  kind.onchange = () => { plot.kind = kind.value; delete plot.fill; changed(); };
  const parts = element('button', { title: 'one plot for each signal', disabled: plot.signals.length < 2 }, 'split');
  parts.onclick = () => split(plot);
  const close = element('button', { title: 'close the plot' }, '×');
  close.onclick = () => { plots.splice(plots.indexOf(plot), 1); changed(); };
  const hint = plot.signals.length ? '' : plot.fill ? 'waits for the gain' : 'drag or click signals of the tree here';
  const node = element('div', { className: 'bar', draggable: true }, element('span', { className: 'chips' }, ...plot.signals.map((_, i) => chip(plot, i)), element('span', { className: 'hint' }, hint)), element('span', { className: 'tools' }, kind, parts, close));
  node.ondragstart = (event) => { dragged = plot; event.dataTransfer.setData('text/plain', ''); };
  return node;
}

// A signal dropped on the left or right half goes to that axis; a plot dropped on another one takes its place.
function acceptDrops(node, plot) {
  const side = (event) => { const box = node.getBoundingClientRect(); return event.clientX < box.left + box.width / 2 ? 'l' : 'r'; };
  const clear = () => node.classList.remove('drop-l', 'drop-r');
  node.ondragover = (event) => { event.preventDefault(); clear(); node.classList.add(`drop-${dragged ? 'l' : side(event)}`); };
  node.ondragleave = clear;
  node.ondrop = (event) => {
    event.preventDefault();
    clear();
    const plots = state.layout.plots, name = event.dataTransfer.getData('text/plain');
    if (dragged && dragged !== plot) {
      plots.splice(plots.indexOf(dragged), 1);
      plots.splice(plots.indexOf(plot), 0, dragged);
      changed();
    } else if (name) add(name, plots.indexOf(plot), side(event));
    dragged = null;
  };
  node.onpointerdown = () => {
    state.active = state.layout.plots.indexOf(plot);
    document.querySelectorAll('.plot').forEach((other) => other.classList.toggle('active', other === node));
  };
}

const FONT = '11px system-ui, "Segoe UI", "DejaVu Sans", sans-serif';
const GRID = { stroke: '#edf0f2', width: 1 };
const axis = (scale, label, side, size) => ({ scale, label, side, size, font: FONT, labelFont: FONT, labelSize: 14, labelGap: 0, stroke: '#3c454d', grid: side === 1 ? { show: false } : GRID, ticks: GRID, values: (u, splits) => { (u.exponents ??= {})[scale] = exponentOf(splits); return splits.map((v) => ticksLabel(v, splits, exponentOf(splits))); } });
// Labels that the axis has no place for are in units of a power of ten, which stands above it.
const LABEL_PLACE = 7;  // characters
function exponentOf(splits) {
  if (splits.every((v) => ticksLabel(v, splits).length <= LABEL_PLACE)) return 0;
  return Math.floor(Math.log10(Math.max(...splits.map(Math.abs))) + 1e-9);
}
function ticksLabel(v, splits, exponent = 0) {
  const step = Math.abs(splits[1] - splits[0]) || 1;
  return Math.abs(v) < step / 1e6 ? '0' : String(Number((v / 10 ** exponent).toPrecision(6)));
}

function unitsOn(plot, side) {
  return [...new Set(plot.signals.filter((s) => (s.axis === 'r') === (side === 'r')).map((s) => unitOf(s.name)))].filter(Boolean).join(', ');
}

// A scale keeps a margin, and magnifies no more than the five digits that the page shows of a number.
function limits(_, min, max) {
  if (min == null || !Number.isFinite(min)) return [0, 1];
  const size = Math.max(Math.abs(min), Math.abs(max));
  if (size < 1e-12) return [-0.1, 1];  // counters at 0
  const pad = Math.max(0.06 * (max - min), 5e-5 * size);
  return [min - pad, max + pad];
}

function build(plot, node) {
  const right = plot.signals.some((s) => s.axis === 'r');
  const series = [{}];
  plot.signals.forEach((s, i) => series.push({ scale: s.axis, spanGaps: /^(gain|bus|status)\./.test(s.name), points: { show: false }, ...style(plot, i) }));
  plot.signals.forEach((s, i) => series.push({ scale: s.axis, show: false, spanGaps: true, points: { show: false }, stroke: ghostColour(style(plot, i).stroke), width: 1.6, dash: [4, 3] }));
  const axes = [{ ...axis('x', null, 2, 28), grid: GRID, values: (_, splits) => splits.map((v, i) => `${ticksLabel(v, splits)}${i === splits.length - 1 ? ' s' : ''}`) }, axis('l', unitsOn(plot, 'l'), 3, 62)];
  if (right) axes.push(axis('r', unitsOn(plot, 'r'), 1, 52));
  const uplot = new uPlot({
    width: Math.max(200, node.clientWidth), height: HEIGHT, padding: [12, right ? 0 : 66, 0, 0],
    scales: { x: { time: false, auto: false }, l: { range: limits }, r: { range: limits } },
    axes, series, legend: { show: false },
    cursor: { sync: { key: 't' }, drag: { x: true, y: false, setScale: false }, points: { show: false } },
    hooks: { draw: [(u) => drawMarks(u, plot)], setSelect: [zoomed], ready: [(u) => listen(u, plot)] },
  }, null, node);
  return uplot;
}

// The charts share their cursor: each of them selects, and the one under the pointer zooms.
function zoomed(u) {
  if (u.select.width < 4) return;
  const k = (px) => origin() + u.posToVal(px, 'x') / T_s();
  const range = [k(u.select.left), k(u.select.left + u.select.width)];
  u.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
  if (u === pressed) show(...range);
}

// Wheel zooms about the pointer, with Shift it moves; a double click follows the drive again.
function listen(u, plot) {
  u.over.addEventListener('wheel', (event) => {
    event.preventDefault();
    const [from, to] = range(), width = to - from;
    if (event.shiftKey || Math.abs(event.deltaX) > Math.abs(event.deltaY)) {
      const step = 0.1 * width * Math.sign(event.deltaX || event.deltaY);
      show(from + step, to + step);
      return;
    }
    const at = origin() + u.posToVal(event.offsetX, 'x') / T_s(), factor = event.deltaY < 0 ? 0.8 : 1.25;
    show(at - (at - from) * factor, at + (to - at) * factor);
  }, { passive: false });
  u.over.addEventListener('dblclick', () => (state.live ? follow() : show(state.brief.first_k, state.brief.last_k + 1)));
  u.over.addEventListener('pointerdown', (event) => grab(event, u, plot), true);
}

// A cursor or the trigger's level near the pointer is dragged instead of a zoom.
function grab(event, u, plot) {
  pressed = u;
  const level = levelOf(plot);
  if (level && Math.abs(u.valToPos(level.value, level.axis) - event.offsetY) < 7) {
    dragging(event, u, (_, y) => dragLevel(u.posToVal(y, level.axis), false), (_, y) => dragLevel(u.posToVal(y, level.axis), true));
    return;
  }
  if (!state.cursors) return;
  for (const which of ['a', 'b'])
    if (Math.abs(u.valToPos((state.cursors[which] - origin()) * T_s(), 'x') - event.offsetX) < 7) {
      const move = (x) => { state.cursors[which] = Math.round(origin() + u.posToVal(x, 'x') / T_s()); tell('cursors'); };
      dragging(event, u, move, move);
      return;
    }
}

function dragging(event, u, move, end) {
  event.stopImmediatePropagation();
  event.preventDefault();
  // uPlot begins its zoom at mousedown.
  const block = (e) => e.stopImmediatePropagation();
  u.over.addEventListener('mousedown', block, { capture: true, once: true });
  const box = u.over.getBoundingClientRect();
  const at = (e, action) => action(e.clientX - box.left, e.clientY - box.top);
  const moved = (e) => at(e, move);
  addEventListener('pointermove', moved);
  addEventListener('pointerup', (e) => { removeEventListener('pointermove', moved); at(e, end); }, { once: true });
}

// A text over curves, readable on any of them.
function writeClear(ctx, text, x, y) {
  ctx.save();
  ctx.setLineDash([]);
  ctx.strokeStyle = '#fff';
  ctx.lineWidth = 4 * devicePixelRatio;
  ctx.lineJoin = 'round';
  ctx.strokeText(text, x, y);
  ctx.restore();
  ctx.fillText(text, x, y);
}

// The power of ten that the labels of an axis are in.
function drawExponents(u) {
  const { ctx, bbox } = u;
  ctx.fillStyle = '#3c454d';
  for (const [scale, x, align] of [['l', bbox.left, 'right'], ['r', bbox.left + bbox.width, 'left']]) {
    const exponent = u.exponents?.[scale];
    if (!exponent) continue;
    ctx.textAlign = align;
    ctx.fillText(`×1e${exponent}`, x, bbox.top - 3 * devicePixelRatio);
  }
}

function verticalLine(u, t, colour, dash, text, row = 0) {
  const { ctx, bbox } = u, x = Math.round(u.valToPos(t, 'x', true));
  if (x < bbox.left || x > bbox.left + bbox.width) return;
  ctx.strokeStyle = ctx.fillStyle = colour;
  ctx.setLineDash(dash);
  ctx.beginPath();
  ctx.moveTo(x, bbox.top);
  ctx.lineTo(x, bbox.top + bbox.height);
  ctx.stroke();
  if (!text) return;
  ctx.textAlign = x > bbox.left + 0.8 * bbox.width ? 'right' : 'left';
  writeClear(ctx, text, x + (ctx.textAlign === 'left' ? 3 : -3) * devicePixelRatio, bbox.top + (10 + 11 * row) * devicePixelRatio);
}

// Events, the trigger, the cursors.
function drawMarks(u, plot) {
  const { ctx } = u, [from, to] = range(), first = plot === state.layout.plots[0];
  ctx.save();
  ctx.lineWidth = devicePixelRatio;
  ctx.font = `${10 * devicePixelRatio}px sans-serif`;
  const t = (k) => (k - origin()) * T_s();
  drawExponents(u);
  state.events.filter((e) => e.k >= from && e.k < to && !e.planned && !e.replaced).slice(-40).forEach((e, i) =>
    verticalLine(u, t(e.k), e.trip ? '#b3261e' : '#8a6d00', [2, 3], first ? e.reason : '', i % 3));
  if (state.view.capture) verticalLine(u, 0, '#0b5cab', [], first ? 'trigger' : '');
  const level = levelOf(plot);
  if (level) horizontalLine(u, level);
  if (state.cursors) for (const which of ['a', 'b']) verticalLine(u, t(state.cursors[which]), which === 'a' ? '#00798c' : '#7b3fa0', [], which.toUpperCase());
  ctx.restore();
}

function horizontalLine(u, level) {
  const { ctx, bbox } = u, y = u.valToPos(level.value, level.axis, true);
  if (y < bbox.top || y > bbox.top + bbox.height) return;
  ctx.strokeStyle = ctx.fillStyle = '#c2500a';
  ctx.setLineDash([8, 4]);
  ctx.beginPath();
  ctx.moveTo(bbox.left, y);
  ctx.lineTo(bbox.left + bbox.width, y);
  ctx.stroke();
  ctx.textAlign = 'right';
  writeClear(ctx, `trigger ${shown(level.value)}`, bbox.left + bbox.width - 3, y - 3 * devicePixelRatio);
}

// Without values in the range shown; a filter that estimates no load sends 0 for it in every tick.
function isAbsent(name) {
  const s = feed.series.get(name), isEmpty = name === 'estimate.T_load_Nm' ? (v) => Number.isNaN(v) || v === 0 : Number.isNaN;
  return !s || s.min.every(isEmpty) && s.max.every(isEmpty);
}

// Two points a bucket, minimum and maximum, so that a peak of one tick is seen.
function curves(plot) {
  const count = Math.max(0, Math.round((feed.end - feed.begin) / feed.bucket)), two = feed.bucket > 1;
  const tail = two && state.view.follow ? feed.tail : null;
  const x = new Float64Array((two ? 2 * count : count) + (tail ? 2 : 0));
  for (let i = 0; i < x.length; ++i) x[i] = (feed.begin - origin() + (two ? i * feed.bucket / 2 : i)) * T_s();
  if (tail) x[x.length - 1] = (Math.max(feed.end + 0.5, tail.end - 1) - origin()) * T_s();
  const interleaved = (s, offset = 0) => {
    const y = new Array(x.length).fill(null);
    if (!s) return y;
    for (let i = 0; i < count; ++i) {
      const min = s.min[i + offset], max = s.max[i + offset];
      if (min === undefined || Number.isNaN(min)) continue;
      if (two) { y[2 * i] = i % 2 ? max : min; y[2 * i + 1] = i % 2 ? min : max; } else y[i] = min;
    }
    return y;
  };
  const own = plot.signals.map((s) => {
    const y = interleaved(isAbsent(s.name) ? null : feed.series.get(s.name)), [min, max] = tail?.series.get(s.name) ?? [];
    if (min != null && !isAbsent(s.name)) y[2 * count] = count % 2 ? max : min, y[2 * count + 1] = count % 2 ? min : max;
    return y;
  });
  const nothing = new Array(x.length).fill(null);
  const ghosts = plot.signals.map((s) => {
    const g = feed.ghost.get(s.name);
    return state.ghost && g && g.bucket === feed.bucket ? interleaved(g, (feed.begin - g.begin) / feed.bucket) : nothing;
  });
  return [x, ...own, ...ghosts];
}

// Plots out of sight are drawn when they come into sight.
const sight = new IntersectionObserver((entries) => {
  for (const entry of entries) entry.target.outOfSight = !entry.isIntersecting;
  if (entries.some((entry) => entry.isIntersecting)) draw();
}, { rootMargin: '100px' });

export function draw(all = false) {
  const [from, to] = range();
  const scale = { min: (from - origin()) * T_s(), max: (to - origin()) * T_s() };
  for (const [plot, { uplot, chips, node }] of charts) {
    if (!uplot || uplot.u === null || (node.outOfSight && all !== true)) continue;
    if (plot.kind !== 'time') continue;
    plot.signals.forEach((s, i) => chips[i]?.classList.toggle('absent', isAbsent(s.name)));
    plot.signals.forEach((_, i) => { uplot.series[1 + plot.signals.length + i].show = !!state.ghost; });  // else they cost time
    uplot.batch(() => { uplot.setData(curves(plot), false); uplot.setScale('x', scale); });
  }
}

export const drawOthers = () => { for (const [plot, { uplot }] of charts) if (plot.kind !== 'time') drawOther(plot, uplot); };

export function rebuild() {
  for (const { uplot } of charts.values()) uplot?.destroy?.();
  charts.clear();
  sight.disconnect();
  const section = byId('plots');
  section.replaceChildren();
  state.layout.plots.forEach((plot, i) => {
    const chart = element('div', { className: 'chart' });
    const node = element('div', { className: `plot${i === state.active ? ' active' : ''}` }, bar(plot), chart);
    node.dataset.kind = plot.kind;
    section.append(node);
    acceptDrops(node, plot);
    charts.set(plot, { uplot: plot.kind === 'time' ? build(plot, chart) : chart, chips: node.querySelectorAll('.chip'), node });
    sight.observe(node);
  });
  draw();
  drawOthers();
}

export function resize() {
  for (const [plot, { uplot }] of charts)
    if (plot.kind === 'time') uplot.setSize({ width: Math.max(200, uplot.root.parentNode.clientWidth), height: HEIGHT });
  drawOthers();
}

// All plots under one another, with their names.
export function exportPng() {
  draw(true);
  const nodes = [...document.querySelectorAll('.plot')], ratio = devicePixelRatio;
  const parts = nodes.flatMap((node) => [...node.querySelectorAll('canvas')].map((canvas) => ({ canvas, title: [...node.querySelectorAll('.chip b')].map((b) => b.textContent).join('   ') })));
  const width = Math.max(...parts.map((p) => p.canvas.width)), line = 18 * ratio;
  const sheet = element('canvas', { width, height: parts.reduce((sum, p) => sum + p.canvas.height + line, 0) });
  const ctx = sheet.getContext('2d');
  ctx.fillStyle = '#fff';
  ctx.fillRect(0, 0, sheet.width, sheet.height);
  ctx.fillStyle = '#1c2126';
  ctx.font = `${11 * ratio}px sans-serif`;
  let y = 0;
  for (const { canvas, title } of parts) {
    ctx.fillText(title, 6 * ratio, y + 13 * ratio);
    ctx.drawImage(canvas, 0, y + line);
    y += canvas.height + line;
  }
  sheet.toBlob((blob) => save('scope.png', blob));
}

// Plots with other axes, of the range shown: one signal against another, over the rotor angle, the spectrum, the
// spectrum over mechanical orders.
//
// Spectra are amplitudes (peak values) with a Hann window of the last 2^n ticks of the range, 2^17 at most. Orders
// resample the signal at equal steps of the measured angle. A tick that is missing is interpolated, and counted.
import { element } from './dom.js';
import { numbers } from './server.js';
import { colourOf } from './plots.js';
import { range, shortName, state, T_s, unitOf } from './state.js';

export const OTHER_KINDS = { time: 'over time', xy: 'x-y', angle: 'over angle', spectrum: 'spectrum', orders: 'orders' };
const MOST_POINTS = 6000, MOST_TICKS = 2 ** 17, HEIGHT = 240;
const ANGLES = ['measurement.theta_m_rad', 'truth.theta_m_rad'];
const busy = new WeakSet(), charts = new WeakMap();

// In place; the length is a power of two.
export function transform(re, im) {
  const n = re.length;
  for (let i = 1, j = 0; i < n; ++i) {
    let bit = n >> 1;
    for (; j & bit; bit >>= 1) j ^= bit;
    j ^= bit;
    if (i < j) { [re[i], re[j]] = [re[j], re[i]]; [im[i], im[j]] = [im[j], im[i]]; }
  }
  for (let length = 2; length <= n; length <<= 1) {
    const angle = -2 * Math.PI / length;
    for (let i = 0; i < n; i += length)
      for (let j = 0; j < length / 2; ++j) {
        const c = Math.cos(angle * j), s = Math.sin(angle * j), a = i + j, b = a + length / 2;
        const x = re[b] * c - im[b] * s, y = re[b] * s + im[b] * c;
        re[b] = re[a] - x; im[b] = im[a] - y;
        re[a] += x; im[a] += y;
      }
  }
}

// Amplitudes of a signal less its mean; a line of amplitude A shows as A.
export function amplitudes(values) {
  const n = values.length, mean = values.reduce((a, b) => a + b, 0) / n;
  const re = Float64Array.from(values, (v, i) => (v - mean) * (0.5 - 0.5 * Math.cos(2 * Math.PI * i / n))), im = new Float64Array(n);
  transform(re, im);
  return Array.from({ length: n / 2 }, (_, i) => 4 * Math.hypot(re[i], im[i]) / n);
}

// Fills what is missing by straight lines; returns how many were.
function bridged(values) {
  let missing = 0, last = -1;
  for (let i = 0; i < values.length; ++i) {
    if (Number.isNaN(values[i])) { ++missing; continue; }
    for (let j = last + 1; j < i; ++j) values[j] = last < 0 ? values[i] : values[last] + (values[i] - values[last]) * (j - last) / (i - last);
    last = i;
  }
  for (let j = last + 1; j < values.length; ++j) values[j] = last < 0 ? 0 : values[last];
  return missing;
}

const powerBelow = (n) => 2 ** Math.floor(Math.log2(Math.max(2, n)));

async function samples(signals, from, to, bucket) {
  const rows = await numbers('samples', { signals, from, to, bucket, capture: state.view.capture }, 1);
  return rows.map((r) => r[0]);
}

function visible() {
  const [from, to] = range();
  return [Math.max(from, state.brief.first_k, 0), Math.min(to, state.brief.last_k + 1)];
}

async function points(signals, x) {
  const [from, to] = visible(), stride = Math.max(1, Math.ceil((to - from) / MOST_POINTS));
  const rows = await samples([x, ...signals], from, to, stride);
  return { x: rows[0], ys: rows.slice(1), told: stride > 1 ? `1 tick of ${stride}` : 'every tick' };
}

async function spectrum(signals) {
  const [from, to] = visible(), n = Math.min(MOST_TICKS, powerBelow(to - from));
  if (to - from < 64) return null;
  const rows = await samples(signals, to - n, to, 1);
  const missing = rows.map(bridged).reduce((a, b) => Math.max(a, b), 0);
  return { x: Array.from({ length: n / 2 }, (_, i) => i / (n * T_s())), ys: rows.map(amplitudes), told: `${n} ticks, ${(1 / (n * T_s())).toPrecision(3)} Hz apart${missing ? `, ${missing} missing ticks interpolated` : ''}` };
}

// At equal steps of the angle, as many as there are ticks; the angle has to turn one way.
async function orders(signals) {
  const [from, to] = visible(), n = Math.min(MOST_TICKS, powerBelow(to - from));
  const rows = await samples([angleSignal(), ...signals], to - n, to, 1);
  const missing = rows.map(bridged).reduce((a, b) => Math.max(a, b), 0);
  const theta = rows[0], turns = (theta[n - 1] - theta[0]) / (2 * Math.PI);
  if (!(Math.abs(turns) > 2)) return { x: [0, 1], ys: signals.map(() => [null, null]), told: 'fewer than two turns in the range' };
  const ys = rows.slice(1).map((values) => {
    const even = new Float64Array(n);
    for (let i = 0, j = 0; i < n; ++i) {
      const wanted = theta[0] + (theta[n - 1] - theta[0]) * i / (n - 1);
      while (j < n - 2 && (theta[j + 1] - wanted) * Math.sign(turns) < 0) ++j;
      const step = theta[j + 1] - theta[j] || 1, share = Math.min(1, Math.max(0, (wanted - theta[j]) / step));
      even[i] = values[j] + (values[j + 1] - values[j]) * share;
    }
    return amplitudes(even);
  });
  return { x: Array.from({ length: n / 2 }, (_, i) => i / Math.abs(turns)), ys, told: `${Math.abs(turns).toFixed(1)} turns${missing ? `, ${missing} missing ticks interpolated` : ''}` };
}

const angleSignal = () => (state.signals.find((s) => s.name === ANGLES[1] && s.value != null) ? ANGLES[1] : ANGLES[0]);

const labelled = (name) => (unitOf(name) ? `${shortName(name)} (${unitOf(name)})` : name);

async function content(plot) {
  const signals = plot.signals.map((s) => s.name);
  if (plot.kind === 'xy') {
    if (signals.length < 2) return null;
    return { ...(await points(signals.slice(1), signals[0])), xLabel: labelled(signals[0]), names: signals.slice(1), dots: true };
  }
  if (!signals.length) return null;
  if (plot.kind === 'angle') {
    const found = await points(signals, angleSignal());
    const x = Array.from(found.x, (v) => ((v % (2 * Math.PI)) + 2 * Math.PI) % (2 * Math.PI));
    return { ...found, x, xLabel: 'mechanical angle (rad)', names: signals, dots: true, span: [0, 2 * Math.PI] };
  }
  const found = await (plot.kind === 'spectrum' ? spectrum(signals) : orders(signals));
  return found && { ...found, xLabel: plot.kind === 'spectrum' ? 'frequency (Hz)' : 'mechanical order', names: signals, log: true, span: plot.kind === 'orders' ? [0, Math.min(100, found.x.at(-1))] : null };
}

export async function drawOther(plot, node) {
  if (busy.has(node) || !state.brief.T_s) return;
  busy.add(node);
  try {
    const found = await content(plot);
    if (found && node.isConnected) paint(plot, node, found);
    else if (!found) node.replaceChildren(element('p', { className: 'soft' }, plot.kind === 'xy' ? ' x-y needs two signals: the first one is x' : ' no signal'));
  } catch (error) {
    state.notice = error.message;
  }
  busy.delete(node);
}

// Dots of an x that goes back and forth: uPlot wants an ascending x, so its series are drawn here.
function dots(u, seriesIndex, from, to) {
  const { ctx } = u, [x, y] = [u.data[0], u.data[seriesIndex]], size = 1.5 * devicePixelRatio;
  const source = u.scattered, all = source.ys[seriesIndex - 1];
  ctx.save();
  ctx.beginPath();
  ctx.rect(u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height);
  ctx.clip();
  ctx.fillStyle = u.colours[seriesIndex - 1];
  ctx.globalAlpha = 0.5;
  for (let i = 0; i < all.length; ++i) {
    if (Number.isNaN(all[i]) || Number.isNaN(source.x[i])) continue;
    ctx.fillRect(u.valToPos(source.x[i], 'x', true) - size / 2, u.valToPos(all[i], 'y', true) - size / 2, size, size);
  }
  ctx.restore();
  return x.length && y.length && from <= to ? null : null;
}

const extent = (values) => values.reduce(([lo, hi], v) => (Number.isFinite(v) ? [Math.min(lo, v), Math.max(hi, v)] : [lo, hi]), [Infinity, -Infinity]);
// Magnifies no more than the five digits that the page shows of a number: uPlot's marks of a narrower axis never end.
function widened([lo, hi]) {
  if (!(lo <= hi)) return [0, 1];
  const pad = Math.max(0.05 * (hi - lo), 5e-5 * Math.max(Math.abs(lo), Math.abs(hi)), 1e-12);
  return [lo - pad, hi + pad];
}

function paint(plot, node, found) {
  const xs = found.span ?? (found.dots ? widened(extent(found.x)) : [0, found.x.at(-1)]);
  const all = found.ys.map(extent), lo = Math.min(...all.map((e) => e[0])), hi = Math.max(...all.map((e) => e[1]));
  const ys = found.log ? [Math.max(hi * 1e-5, 1e-12), Math.max(hi * 2, 1e-11)] : widened([lo, hi]);
  const data = found.dots ? [xs, ...found.ys.map(() => ys)] : [found.x, ...found.ys.map((y) => y.map((v) => (v > ys[0] ? v : ys[0])))];
  let u = charts.get(node);
  const shape = JSON.stringify([plot.kind, found.names, found.xLabel]);
  if (!u || u.shape !== shape) {
    u?.destroy();
    node.replaceChildren();
    u = make(plot, node, found);
    u.shape = shape;
    u.told = element('span', { className: 'soft' });
    node.append(u.told);
    charts.set(node, u);
  }
  u.scattered = found;
  u.told.textContent = ` ${found.told}`;
  u.batch(() => { u.setData(data, false); u.setScale('x', { min: xs[0], max: xs[1] }); u.setScale('y', { min: ys[0], max: ys[1] }); });
}

function make(plot, node, found) {
  const font = '11px system-ui, "Segoe UI", "DejaVu Sans", sans-serif', grid = { stroke: '#edf0f2', width: 1 };
  const units = [...new Set(found.names.map(unitOf))].filter(Boolean).join(', ');
  const axis = { font, labelFont: font, stroke: '#3c454d', grid, ticks: grid, labelSize: 16 };
  const few = (_, splits) => splits.map((v) => (v == null ? '' : Math.abs(v) < 1e-14 ? '0' : String(Number(v.toPrecision(4)))));
  const decades = (_, splits) => splits.map((v) => (v != null && Math.abs(Math.log10(v) - Math.round(Math.log10(v))) < 1e-6 ? v.toExponential(0) : ''));
  const colours = plot.signals.map((_, i) => colourOf(plot, i)).slice(plot.kind === 'xy' ? 1 : 0);
  const u = new uPlot({
    width: Math.max(200, node.clientWidth), height: HEIGHT, legend: { show: false }, cursor: { drag: { x: false, y: false } },
    scales: { x: { time: false, auto: false }, y: found.log ? { distr: 3, auto: false } : { auto: false } },
    axes: [{ ...axis, label: found.xLabel, size: 40, values: few }, { ...axis, label: `${found.log ? 'amplitude of ' : ''}${found.names.length === 1 ? labelled(found.names[0]) : units || 'signals'}`, size: 66, values: found.log ? decades : few }],
    series: [{}, ...found.names.map((_, i) => ({ stroke: colours[i], width: 1.2, points: { show: false }, ...(found.dots ? { paths: dots } : {}) }))],
  }, [[0, 1], ...found.names.map(() => [1, 2])], node);
  return Object.assign(u, { colours });
}

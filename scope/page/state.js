// What the page shows: layout, view, and the newest that the server told. Every part of the page reads it.
//
// Ticks are the axis: t = k T_s. A view follows the drive (the last `window_s`), or stands at [from, to) of the
// drive, or of a capture.

export const state = {
  brief: { first_k: -1, last_k: -1, T_s: 0, generation: 0, captures: [], trigger: {} },
  live: null,       // null: a log
  holder: '',       // the page of this server that has the control
  other_holder: '', // another program
  signals: [],      // of the tree: {name, unit, comment, value}
  drive: {},
  processes: [],    // of the tree: {role, state, ..}
  events: [],
  view: { follow: true, from: 0, to: 0, capture: 0 },
  layout: null,
  cursors: null,    // {a, b} in ticks
  ghost: null,      // {source, capture, shift, by, label}
  active: 0,        // plot to which a click in the tree goes
};

const listeners = {};
export function on(what, action) { (listeners[what] ??= []).push(action); }
export function tell(what) { (listeners[what] ?? []).forEach((action) => action()); }

export const T_s = () => state.brief.T_s || 1e-4;
export const unitOf = (name) => state.signals.find((s) => s.name === name)?.unit ?? guessedUnit(name);

// Until the drive was heard: the unit at the end of the name.
function guessedUnit(name) {
  const known = { rad_s: 'rad/s', rad: 'rad', A: 'A', V: 'V', Nm: 'Nm', Hz: 'Hz', us: 'us' };
  const end = Object.keys(known).find((u) => name.replace(/\[.*/, '').endsWith(`_${u}`));
  return end ? known[end] : '';
}

// A name without the unit that its axis has: "estimate.omega_m"; an entry of K or P by row and column: "gain.P44".
export function shortName(name) {
  const entry = name.match(/^gain\.([KP])\[(\d+)\]$/);
  const columns = entry && state.signals.find((s) => s.name === (entry[1] === 'P' ? 'gain.n_x' : 'gain.n_y'))?.value;
  if (columns > 0 && columns < 10) return `gain.${entry[1]}${Math.floor(entry[2] / columns) + 1}${entry[2] % columns + 1}`;
  const unit = unitOf(name).replace('/', '_');
  return unit && name.endsWith(`_${unit}`) ? name.slice(0, -unit.length - 1) : name;
}

// The ticks [from, to) that are shown.
export function range() {
  const { view } = state;
  if (!view.follow) return [view.from, view.to];
  const last = state.shown_k ?? state.brief.last_k;
  const ticks = Math.max(2, Math.round(state.layout.window_s / T_s())), begin = Math.max(0, state.brief.first_k);
  const from = Math.max(begin, last + 1 - ticks);  // at its start a drive fills the window from the left
  return [from, from + ticks];
}

export function show(from, to) {
  const span = Math.max(4, to - from);
  state.view = { ...state.view, follow: false, from: Math.round(from), to: Math.round(from + span) };
  tell('view');
}

export function follow() {
  state.view = { follow: true, from: 0, to: 0, capture: 0 };
  tell('view');
}

export function whole() {
  const capture = state.brief.captures.find((c) => c.id === state.view.capture);
  if (capture) show(capture.from, capture.to);
  else show(Math.max(0, state.brief.first_k), state.brief.last_k + 1);
}

// Time on the axis: of the drive, or after the trigger of a capture.
export function origin() {
  return state.brief.captures.find((c) => c.id === state.view.capture)?.trigger_k ?? 0;
}

const plot = (...signals) => ({ kind: 'time', signals: signals.map((s) => (s.endsWith('>') ? { name: s.slice(0, -1), axis: 'r' } : { name: s, axis: 'l' })) });

export function firstLayout() {
  const busPlots = [  // a log has no rates
    plot('bus.measurement.rate_Hz', 'bus.gain.rate_Hz', 'bus.estimate.latency_us>', 'bus.command.latency_us>'),
    plot('bus.measurement.gaps', 'bus.estimate.gaps', 'status.plant.deadline_misses', 'status.plant.late_commands', 'status.estimator.late_gains'),
  ];
  return {
    window_s: 2,
    plots: [
      plot('reference.omega_m_ref_rad_s', 'truth.omega_m_rad_s', 'estimate.omega_m_rad_s'),
      plot('drive.angle_error_rad', 'drive.speed_error_rad_s>'),
      plot('truth.i_d_A', 'truth.i_q_A', 'estimate.i_d_A', 'estimate.i_q_A', 'command.i_d_ref_A', 'command.i_q_ref_A'),
      plot('drive.u_d_V', 'drive.u_q_V', 'drive.u_abs_V', 'drive.u_limit_V'),
      plot('truth.T_em_Nm', 'truth.T_load_Nm', 'estimate.T_load_Nm'),
      { kind: 'time', signals: [], fill: 'gain' },
      ...(state.live ? busPlots : []),
    ],
  };
}

// The variance of the last state (the angle of most filters) and its gains: their places follow from n_x and n_y.
export function fillGainPlot() {
  const value = (name) => state.signals.find((s) => s.name === name)?.value;
  const n_x = value('gain.n_x'), n_y = value('gain.n_y');
  for (const p of state.layout.plots) {
    if (p.fill !== 'gain' || !n_x || !n_y) continue;
    delete p.fill;
    p.signals = [];
    p.signals.push({ name: `gain.P[${n_x * n_x - 1}]`, axis: 'l' });
    for (let j = 0; j < n_y; ++j) p.signals.push({ name: `gain.K[${(n_x - 1) * n_y + j}]`, axis: 'r' });
    tell('layout');
  }
}

// A layout is an address: it loads without the drive.
export function layoutInAddress() {
  const bytes = new TextEncoder().encode(JSON.stringify(state.layout));
  return btoa(String.fromCharCode(...bytes)).replaceAll('+', '-').replaceAll('/', '_').replace(/=+$/, '');
}

export function layoutFrom(text) {
  const bytes = Uint8Array.from(atob(text.replaceAll('-', '+').replaceAll('_', '/')), (c) => c.charCodeAt(0));
  return checkedLayout(JSON.parse(new TextDecoder().decode(bytes)));
}

export function checkedLayout(layout) {
  const kinds = ['time', 'xy', 'angle', 'spectrum', 'orders'];
  const good = layout && layout.window_s > 0 && Array.isArray(layout.plots) &&
    layout.plots.every((p) => kinds.includes(p.kind) && Array.isArray(p.signals) && p.signals.every((s) => typeof s.name === 'string'));
  if (!good) throw new Error('no layout: {"window_s": 2, "plots": [{"kind": "time", "signals": [{"name": .., "axis": "l"}]}]} allowed');
  return layout;
}

// The page: what comes from the server goes to the parts, what a person does goes to the state.
import { byId, element, save, seconds, shown } from './dom.js';
import { feed, fetchStatistics, loadGhost, refresh, sinceFrame_s, wanted } from './feed.js';
import { refreshFindings } from './findings.js';
import { buildGhost } from './ghost.js';
import { draw, drawOthers, exportPng, rebuild, resize } from './plots.js';
import { download, get, numbers, trace } from './server.js';
import { checkedLayout, fillGainPlot, firstLayout, follow, layoutFrom, layoutInAddress, on, range, show, state, T_s, tell, whole } from './state.js';
import { buildSteering, refreshSteering } from './steering.js';
import { refreshTree } from './tree.js';
import { buildTrigger, refreshTrigger } from './trigger.js';

const WINDOWS = [0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 60];

const STORED = () => `twinrate scope layout ${state.live ? 'live' : 'run'}`;

// The layout of the address, else the last one of this browser, else the first one.
function startLayout() {
  const address = location.hash.match(/layout=([\w-]+)/);
  for (const read of [() => address && layoutFrom(address[1]), () => checkedLayout(JSON.parse(localStorage.getItem(STORED())))]) {
    try {
      const layout = read();
      if (layout) return layout;
    } catch { /* the next one */ }
  }
  return firstLayout();
}

function keepLayout() {
  localStorage.setItem(STORED(), JSON.stringify(state.layout));
  history.replaceState(null, '', `${location.pathname}${location.search}#layout=${layoutInAddress()}`);
}

on('layout', () => { keepLayout(); byId('window').value = state.layout.window_s; rebuild(); refresh(); loadGhost().then(draw); });
on('view', () => { refresh(); draw(); drawOthers(); showBar(); loadGhost().then(draw); });
on('ghost', () => loadGhost().then(draw, (error) => { state.notice = error.message; }));
on('cursors', () => { draw(); showStatistics(); });
on('loaded', () => { draw(); loadGhost().then(draw); });
on('events', listEvents);
// A page on a slow machine draws two thirds of the time at most: it stays open to clicks.
let due = false, behind = false, rest_ms = 0;
function drawSoon() {
  behind = due;
  if (due) return;
  due = true;
  setTimeout(() => requestAnimationFrame(() => {
    const begun = performance.now();
    if (state.view.follow) draw();
    refreshTrigger();
    showBar();
    if (planned && state.events.some((e) => e.planned && e.k <= state.brief.last_k)) listEvents();
    rest_ms = performance.now() - begun;
    due = false;
    if (behind) drawSoon();  // a frame came meanwhile
  }), rest_ms / 2);
}
on('frame', drawSoon);

function showBar() {
  const { live, brief, view } = state, lamp = byId('lamp'), notice = byId('notice');
  const silent = live?.silent_s > 1, ended = silent && state.processes.find((p) => /plant|bridge/.test(p.role))?.state === 'done';
  const lost = sinceFrame_s() > 2 ? 'The server does not answer: twinrate scope, or the launch --scope that started it, has ended. The page connects again by itself.'
    : live && !live.heard ? `No drive heard yet on ${live.url}. Start one: twinrate launch DRIVE --pace wall --duration inf`
    : ended ? `The run has ended at ${(brief.last_k * T_s()).toFixed(2)} s. The page goes on when another one starts.`
    : silent ? `Nothing heard on ${live.url} for ${Math.floor(live.silent_s)} s: the bus or the drive is gone. The page goes on when it comes back.`
    : '';
  const waits = live && !live.heard || ended;
  const [text, kind] = lost && sinceFrame_s() <= 2 && waits ? [ended ? 'ended' : 'no drive', 'held'] : lost ? ['lost', 'lost'] : view.capture ? [`capture ${view.capture}`, 'past'] : !view.follow ? [live ? 'held' : 'run', live ? 'held' : 'past'] : live ? ['live', 'live'] : ['run', 'past'];
  lamp.textContent = text;
  lamp.className = `lamp ${kind}`;
  notice.textContent = lost || state.notice || '';
  notice.hidden = !notice.textContent;
  notice.classList.toggle('plain', kind === 'held');
  document.body.classList.toggle('stale', !!lost);
  showMode(!!lost);
  byId('clock').textContent = brief.last_k >= 0 ? `${(brief.last_k * T_s()).toFixed(2)} s, tick ${brief.last_k}` : '';
  byId('follow').classList.toggle('on', view.follow);
  byId('follow').hidden = !live;
  const ghost = state.ghost ? ` Thin dashed: ${state.ghost.label}.` : '';
  byId('decimation').textContent = brief.last_k < 0 ? '' : (feed.bucket > 1 ? `Each point pair is the minimum and maximum of ${feed.bucket} ticks (${(1000 * feed.bucket * T_s()).toPrecision(3)} ms); no peak is left out.` : 'Every tick is drawn.') +
    `${brief.last_k >= 0 ? ` Kept: ${((brief.last_k - Math.max(0, brief.first_k)) * T_s()).toFixed(1)} s at ${shown(1 / T_s())} Hz.` : ''}${feed.skipped ? ` ${feed.skipped} ticks were not streamed to this page.` : ''}${ghost}`;
}

// The mode of the command that the drive applies; in safe mode the fault that led to it, and the way out.
const MODES = [['run', 'live'], ['align', 'held'], ['I/f ramp', 'held'], ['SAFE', 'lost']];
function showMode(lost) {
  const node = byId('mode'), mode = state.live && !lost && MODES[state.signals.find((s) => s.name === 'measurement.mode')?.value];
  node.hidden = !mode;
  if (!mode) return;
  const trip = mode[0] === 'SAFE' && state.events.findLast((e) => e.trip);
  node.textContent = trip ? `SAFE: ${trip.reason.replaceAll('_', ' ')}` : mode[0];
  node.title = mode[0] === 'SAFE' ? 'the drive is off; take control, then reset' : 'mode of the command that the drive applies';
  node.className = `lamp ${mode[1]}`;
}

// What was asked for a later tick, and what replaced it by then, is no mark yet, or never one.
const keysOf = (text) => new Set(text.split('\n').filter(Boolean).map((line) => line.split('=')[0]).map((key) => (/^(start|stop|speed_rpm|omega_e_rad_s)$/.test(key) ? 'speed' : key)));
let planned = 0;
function judgeEvents() {
  planned = 0;
  let earliest = Infinity;  // tick of the requests behind
  for (let i = state.events.length - 1; i >= 0; --i) {
    const e = state.events[i];
    e.planned = e.k > state.brief.last_k && /^(steered|effect_)/.test(e.reason);
    if (e.planned) ++planned;
    if (e.reason !== 'steered') continue;
    if (earliest < e.k) {
      const keys = keysOf(e.text);
      for (const later of state.events.slice(i + 1)) if (later.reason === 'steered' && later.k < e.k) keysOf(later.text).forEach((key) => keys.delete(key));
      e.replaced = keys.size === 0;
    }
    earliest = Math.min(earliest, e.k);
  }
}

function listEvents() {
  judgeEvents();
  byId('events').querySelector('ol').replaceChildren(...state.events.slice(-200).reverse().map((e) => {
    const told = /^(steered|control_)/.test(e.reason) ? `${e.reason}: ${e.text}` : `${e.reason} (${e.role})`;
    const node = element('li', { className: `entry${e.trip ? ' trip' : ''}`, title: `${e.role}: ${e.text}` }, element('span', { className: 'when' }, `${(e.k * T_s()).toFixed(3)} s`), element('span', { className: 'what' }, e.replaced ? `replaced before its tick: ${told}` : e.planned ? `not yet: ${told}` : told));
    node.onclick = () => {
      const half = state.layout.window_s / T_s() / 2;
      state.view.capture = 0;
      show(e.k - half, e.k + half);
    };
    return node;
  }));
  refreshFindings();
}

async function showStatistics() {
  const [from, to] = range(), names = wanted();
  if (!byId('numbers').open || !names.length || !state.brief.T_s || to <= 0) return;
  const list = await fetchStatistics(names, from, to).catch(() => []);
  const { cursors } = state;
  let at = null;
  if (cursors) {
    const read = (k) => numbers('samples', { signals: names, from: Math.max(0, k), to: Math.max(0, k) + 1, bucket: 1, capture: state.view.capture }, 1);
    at = await Promise.all([read(cursors.a), read(cursors.b)]).catch(() => null);
  }
  const unit = (name) => state.signals.find((s) => s.name === name)?.unit ?? '';
  const head = ['signal', 'min', 'max', 'mean', 'rms', 'peak to peak', ...(at ? ['A', 'B', 'B − A'] : []), ''];
  const rows = list.filter((s) => s.count).map((s) => {
    const i = names.indexOf(s.signal), a = at?.[0][i][0][0], b = at?.[1][i][0][0];
    return [s.signal, ...[s.min, s.max, s.mean, s.rms, s.peak_to_peak, ...(at ? [a, b, b - a] : [])].map(shown), unit(s.signal)];
  });
  const cell = (tag) => (text) => element(tag, {}, text);
  const dt = cursors ? (cursors.b - cursors.a) * T_s() : 0;
  byId('readout').textContent = cursors ? `A ${seconds(cursors.a * T_s())}   B ${seconds(cursors.b * T_s())}   dt ${shown(dt * 1000)} ms   1/dt ${dt ? shown(1 / Math.abs(dt)) : '–'} Hz   (${cursors.b - cursors.a} ticks)` : '';
  byId('statistics').replaceChildren(
    element('table', {}, element('tr', {}, ...head.map(cell('th'))), ...rows.map((r) => element('tr', {}, ...r.map(cell('td'))))));
}

function toggleCursors() {
  const [from, to] = range();
  state.cursors = state.cursors ? null : { a: Math.round(from + (to - from) / 3), b: Math.round(from + 2 * (to - from) / 3) };
  if (state.cursors && state.view.follow) show(from, to);
  byId('cursors').classList.toggle('on', !!state.cursors);
  if (state.cursors) byId('numbers').open = true;
  tell('cursors');
}

function visibleRange() {
  const [from, to] = range();
  return { from: Math.max(0, from), to: Math.min(to, state.brief.last_k + 1), capture: state.view.capture };
}

function buildHeader(info) {
  byId('source').textContent = info.live ? info.live.url : info.title;
  byId('window').replaceChildren(...WINDOWS.map((w) => element('option', { value: w, selected: w === state.layout.window_s }, w < 1 ? `${w * 1000} ms` : `${w} s`)));
  byId('window').onchange = (event) => {
    state.layout.window_s = Number(event.target.value);
    keepLayout();
    const [from, to] = range(), middle = (from + to) / 2, half = state.layout.window_s / T_s() / 2;
    if (state.view.follow) tell('view'); else show(middle - half, middle + half);
  };
  byId('follow').onclick = follow;
  byId('whole').onclick = whole;
  byId('cursors').onclick = toggleCursors;
  byId('add-plot').onclick = () => { state.layout.plots.unshift({ kind: 'time', signals: [] }); state.active = 0; tell('layout'); };
  byId('export-csv').onclick = () => download('csv', { ...visibleRange(), signals: wanted().join(',') });
  byId('export-trace').onclick = () => download('csv', { ...visibleRange(), trace: 1 });
  byId('trace').onclick = () => trace(visibleRange(), (text) => { state.notice = text; });
  byId('export-png').onclick = exportPng;
  byId('export-layout').onclick = () => save('scope-layout.json', JSON.stringify(state.layout, null, 2), 'application/json');
  byId('default-layout').onclick = () => { state.layout = firstLayout(); tell('layout'); };
  byId('import-layout').onchange = async (event) => {
    try {
      state.layout = checkedLayout(JSON.parse(await event.target.files[0].text()));
      tell('layout');
    } catch (error) {
      state.notice = `layout: ${error.message}`;
    }
  };
}

addEventListener('keydown', (event) => {
  if (/INPUT|TEXTAREA|SELECT/.test(event.target.tagName) || event.ctrlKey || event.metaKey) return;
  if (event.key === 'f') follow();
  if (event.key === 'c') toggleCursors();
});
byId('numbers').addEventListener('toggle', () => { resize(); showStatistics(); });
new ResizeObserver(resize).observe(byId('plots'));

async function everyHalfSecond() {
  try {
    const tree = await get('tree');
    Object.assign(state, { signals: tree.signals, drive: tree.drive, processes: tree.processes });
    fillGainPlot();
    refreshTree(tree);
    refreshSteering();
    if (state.ghost && state.view.follow) await loadGhost();
    if (state.view.follow) drawOthers();
    await showStatistics();
  } catch { /* the bar says that the server does not answer */ }
  showBar();
  setTimeout(everyHalfSecond, 500);
}

// A log is read while the page is open: its whole range grows until it is there.
function showLog() {
  let shown_to = -1;
  on('frame', () => {
    const { first_k, last_k, T_s: step } = state.brief;
    const untouched = state.view.to === shown_to || shown_to < 0;
    if (!step || last_k + 1 === shown_to || !untouched) return;
    shown_to = last_k + 1;
    show(Math.max(0, first_k), shown_to);
  });
}

const info = await get('info');
Object.assign(state, { brief: info.brief, live: info.live });
state.layout = startLayout();
buildHeader(info);
buildTrigger();
buildGhost(info.runs);
buildSteering();
if (!info.live) {
  state.view.follow = false;
  byId('trigger').hidden = true;
  showLog();
}
rebuild();
refresh();
everyHalfSecond();
window.scope = { state, feed, show, follow };

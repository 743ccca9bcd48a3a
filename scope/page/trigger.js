// The trigger: settings, list of captures, two of them overlaid. It runs in the server.
import { byId, element } from './dom.js';
import { post } from './server.js';
import { on, show, state, T_s, tell } from './state.js';

const REFERENCE_STEP = 'reference step';  // no event of a process: a change of the speed reference
const EVENTS = [REFERENCE_STEP, 'trip', 'lost_synchronism', 'model_misfit', 'effect_proposed', 'effect_added', 'mode_change', 'state_change', 'over_current', 'sensor_fault', 'any'];
const draft = { source: 'estimate.omega_m_rad_s', edge: 'rising', level: 0, hysteresis: 0, pre_percent: 50, length_s: 0.2, holdoff_s: 0 };
let list, lamp, buttons = {}, fields = {};

async function send(mode) {
  state.level_shown = mode !== 'stop';
  state.notice = '';
  const event = draft.source.startsWith('event: ') ? draft.source.slice(7) : '';
  const step = event === REFERENCE_STEP;
  const signal = step ? 'reference.omega_m_ref_rad_s' : event ? '' : draft.source;
  try {
    await post('trigger', { mode, signal, event: step ? '' : event, edge: step ? 'change' : draft.edge, level: draft.level, hysteresis: draft.hysteresis, pre_share: draft.pre_percent / 100,
      length_ticks: Math.max(2, Math.round(draft.length_s / T_s())), holdoff_ticks: Math.round(draft.holdoff_s / T_s()) });
  } catch (error) {
    state.notice = error.message;
  }
}

const armed = () => state.brief.trigger.mode && state.brief.trigger.mode !== 'stop';
const settled = () => { state.level_shown = true; return armed() ? send(state.brief.trigger.mode) : tell('cursors'); };

function field(label, name, unit = '') {
  const input = element('input', { type: 'number', step: 'any', value: draft[name], id: `trigger-${name}` });
  input.onchange = () => { draft[name] = Number(input.value); settled(); };
  fields[name] = input;
  return [element('label', { htmlFor: input.id }, unit ? `${label} (${unit})` : label), input];
}

function choice(label, name, values) {
  const select = element('select', { id: `trigger-${name}` }, ...values.map((v) => element('option', { value: v, selected: v === draft[name] }, v)));
  select.onchange = () => { draft[name] = select.value; settled(); };
  fields[name] = select;
  return [element('label', { htmlFor: select.id }, label), select];
}

// The sources are the signals of all plots, and every signal that is typed in.
function source() {
  const input = element('input', { id: 'trigger-source', value: draft.source });
  input.setAttribute('list', 'trigger-sources');
  const options = element('datalist', { id: 'trigger-sources' });
  const fill = () => options.replaceChildren(...EVENTS.map((e) => element('option', { value: `event: ${e}` })), ...state.signals.map((s) => element('option', { value: s.name })));
  input.onfocus = fill;
  input.onchange = () => { draft.source = input.value.trim(); settled(); };
  fields.source = input;
  return [element('label', { htmlFor: input.id }, 'source'), element('span', {}, input, options)];
}

function modeButton(mode) {
  const button = element('button', { id: `trigger-${mode}` }, mode);
  button.onclick = () => send(mode);
  buttons[mode] = button;
  return button;
}

export function buildTrigger() {
  const force = element('button', { id: 'trigger-force', title: 'capture now' }, 'force');
  force.onclick = () => send(state.brief.trigger.mode ?? 'stop').then(() => post('trigger', { force: true })).catch((error) => { state.notice = error.message; });
  lamp = element('span', { className: 'soft' });
  list = element('ol', { id: 'captures' });
  byId('trigger').replaceChildren(
    element('h2', {}, 'Trigger'),
    element('fieldset', {}, ...source(), ...choice('edge', 'edge', ['rising', 'falling', 'either', 'change']), ...field('level', 'level'), ...field('hysteresis', 'hysteresis'), ...field('pre-trigger', 'pre_percent', '%'), ...field('length', 'length_s', 's'), ...field('hold-off', 'holdoff_s', 's')),
    element('div', { className: 'row-buttons' }, ...['auto', 'normal', 'single', 'stop'].map(modeButton), force), lamp, list);
  fields.source.style.width = '100%';
}

function open(capture) {
  state.view = { follow: false, from: capture.from, to: capture.to, capture: capture.id };
  state.ghost = null;
  show(capture.from, capture.to);
}

function overlay(capture) {
  const main = state.brief.captures.find((c) => c.id === state.view.capture);
  if (!main || main.id === capture.id) return;
  state.ghost = { capture: capture.id, shift: capture.trigger_k - main.trigger_k, label: `capture ${capture.id}` };
  tell('ghost');
}

let listed = '';
export function refreshTrigger() {
  const { trigger, captures } = state.brief;
  for (const [mode, button] of Object.entries(buttons)) button.classList.toggle('on', trigger.mode === mode);
  lamp.textContent = trigger.capturing ? 'capturing ..' : armed() ? 'armed' : '';
  const now = JSON.stringify([captures.map((c) => c.id), state.view.capture, state.ghost?.capture]);
  if (now === listed) return;
  listed = now;
  list.replaceChildren(...captures.toReversed().map((c) => {
    const over = element('button', { title: 'overlay on the capture that is shown', disabled: !state.view.capture || c.id === state.view.capture }, 'overlay');
    over.onclick = (event) => { event.stopPropagation(); overlay(c); };
    const ticks = c.missing ? `${c.missing} of ${c.to - c.from} ticks missing` : `${c.to - c.from} ticks`;
    const node = element('li', { className: `entry${c.id === state.view.capture ? ' on' : ''}`, title: `${c.cause}; ${ticks}` }, element('span', { className: 'when' }, `#${c.id} ${(c.trigger_k * T_s()).toFixed(4)} s`), element('span', { className: 'what' }, ticks), over);
    node.onclick = () => open(c);
    return node;
  }));
}

// The level as a line in a plot that shows the source.
export function levelOf(plot) {
  if (draft.edge === 'change' || draft.source.startsWith('event') || (!armed() && !state.level_shown)) return null;
  const signal = plot.signals.find((s) => s.name === draft.source);
  return signal && { value: draft.level, axis: signal.axis };
}

export function dragLevel(value, end) {
  draft.level = Number(value.toPrecision(4));
  fields.level.value = draft.level;
  if (end) settled(); else tell('cursors');
}

on('view', () => { if (state.view.follow && state.ghost?.capture) state.ghost = null; refreshTrigger(); });
on('ghost', () => refreshTrigger());

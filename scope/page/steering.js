// The panel that steers: watch-only until control is taken; one page holds it. Stop and emergency stop need none.
import { byId, element, shown } from './dom.js';
import { client, post } from './server.js';
import { state } from './state.js';

let take, who, told, steered = [], speeds, ranges = {};

// True where the drive took it.
export async function ask(kind, text = '') {
  try {
    const { replies } = await post('request', { client, kind, text });
    told.classList.toggle('refused', replies.some((r) => !r.accepted));
    told.textContent = replies.length ? `${kind}: ${replies.map((r) => `${r.role} ${r.accepted ? (r.applied_k >= 0 ? `from tick ${r.applied_k} on` : 'accepted') : `refused, ${r.text}`}`).join('; ')}` : `${kind}: sent; no answer in time: the events tell what was applied`;
    return replies.length > 0 && replies.every((r) => r.accepted);
  } catch (error) {
    told.textContent = error.message;
  }
  return false;
}

function button(label, kind, title, steers = true) {
  const node = element('button', { data: { kind }, title }, label);
  node.onclick = () => ask(kind);
  if (steers) steered.push(node);
  return node;
}

// What can be set (core/steering.hpp): its label with unit, or its choices.
const settings = [
  ['speed_rpm', 'speed (rpm)'], ['omega_e_rad_s', 'omega_e (rad/s)'], ['load_Nm', 'load (Nm)'], ['n', 'n (ticks a gain)'],
  ['policy', ['paper', 'immediate', 'extrapolate', 'rotate', 'rotor_frame', 'scheduled', 'propagated']],
  ['compensation', ['off', 'paper', 'angle_domain', 'load']]];

function setting([key, form]) {
  const list = Array.isArray(form);
  const input = list ? element('select', { name: key }, ...['', ...form].map((text) => element('option', {}, text)))
    : element('input', { name: key, type: 'number', step: 'any', size: 8 });
  const send = () => (input.value !== '' ? ask('steer', `${key}=${input.value}`) : true);
  if (list) input.onchange = async () => { if (!await send()) input.value = ''; };  // a choice that was refused does not hold
  else input.onkeydown = (event) => { if (event.key === 'Enter') send(); };
  steered.push(input);
  const range = element('span', { className: 'soft range' });
  ranges[key] = { input, range };
  return element('label', { className: 'setting' }, element('span', { className: 'soft' }, list ? key : form), input, range);
}

// What the drive file allows (core/steering_limits.hpp), beside each field.
function showRanges() {
  const { omega_m_max_rad_s: speed, load_max_Nm: load, n_p } = state.drive;
  const most = { speed_rpm: speed * 30 / Math.PI, omega_e_rad_s: speed * n_p, load_Nm: load };
  for (const [key, { input, range }] of Object.entries(ranges)) {
    if (!(most[key] > 0)) continue;
    const limit = Number((0.9999995 * most[key]).toPrecision(6));
    range.textContent = `-${shown(limit)} to ${shown(limit)}`;
    Object.assign(input, { min: -most[key], max: most[key] });
  }
  if (n_p) Object.assign(ranges.n.input, { min: 1, max: 100000 }), ranges.n.range.textContent = '1 to 100000';
}

export function buildSteering() {
  take = element('button', { id: 'take-control' });
  take.onclick = async () => {
    try {
      await post('control', { client, take: state.holder !== client });
    } catch (error) {
      told.textContent = error.message;
    }
  };
  who = element('span', { className: 'soft' });
  told = element('p', { className: 'soft', id: 'steering-told' });
  speeds = element('div', { className: 'speeds' });
  const effects = element('textarea', { rows: 3, placeholder: '[[effect]]\nkind = "cogging"\n..', style: 'width:100%' });
  const addEffects = element('button', {}, 'add'), removeEffects = element('button', {}, 'take off');
  addEffects.onclick = () => ask('add_effects', effects.value);
  removeEffects.onclick = () => ask('remove_effects', effects.value);
  steered.push(addEffects, removeEffects, effects);
  byId('steering').replaceChildren(element('h2', {}, 'Drive'), speeds,
    element('div', { className: 'row-buttons' }, take, who),
    element('div', { className: 'row-buttons' }, button('start', 'start', 'after a stop: back to the speed reference that it had'), button('reset', 'reset', 'from SAFE to IDLE; the drive then starts anew and runs to its speed reference'), button('stop', 'stop', 'to speed 0 on a ramp; needs no control', false)),
    element('div', { className: 'settings' }, ...settings.map(setting)),
    element('details', {}, element('summary', {}, 'effects of the model'), effects, element('div', { className: 'row-buttons' }, addEffects, removeEffects)), told);
  byId('estop').onclick = () => ask('emergency_stop');
  addEventListener('keydown', (event) => { if (event.key === 'Escape' && state.live) ask('emergency_stop'); });
}

const value = (name) => state.signals.find((s) => s.name === name)?.value;

// Another run has none of what was sent to the one before.
let generation = -1;
function beginAnew() {
  if (generation >= 0 && generation !== state.brief.generation) {
    for (const { input } of Object.values(ranges)) input.value = '';
    told.textContent = '';
  }
  generation = state.brief.generation;
}

export function refreshSteering() {
  beginAnew();
  byId('steering').hidden = byId('estop').hidden = !state.live;
  if (!state.live) return;
  const mine = state.holder === client;
  take.textContent = mine ? 'give control back' : 'take control';
  take.disabled = !!state.holder && !mine;
  take.classList.toggle('on', mine);
  who.textContent = mine ? 'this page has the control' : state.holder ? 'another page has the control' : state.other_holder ? `${state.other_holder} has the control` : 'watch only';
  for (const node of steered) node.disabled = !mine;
  const omega = value('truth.omega_m_rad_s') ?? value('estimate.omega_m_rad_s'), n_p = state.drive.n_p;
  showRanges();
  speeds.replaceChildren(
    element('span', {}, element('span', { className: 'soft' }, 'mechanical'), element('br'), element('b', {}, shown(omega == null ? null : Math.round(omega * 30 / Math.PI * 10) / 10)), ' rpm'),
    element('span', {}, element('span', { className: 'soft' }, n_p ? `electrical (n_p ${n_p})` : 'electrical'), element('br'), element('b', {}, shown(n_p && omega != null ? Math.round(omega * n_p * 10) / 10 : null)), ' rad/s'),
    ...(state.drive.rated_torque_Nm ? [element('span', { className: 'soft' }, `rated ${shown(state.drive.rated_torque_Nm)} Nm`)] : []));
}

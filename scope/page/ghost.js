// Another run behind the drive, aligned on the start, the trip, the trigger or the angle.
import { byId, element } from './dom.js';
import { get } from './server.js';
import { range, state, tell } from './state.js';

let run, by;

async function choose() {
  state.notice = '';
  if (!run.value) {
    state.ghost = null;
    tell('ghost');
    return;
  }
  const [from, to] = range();
  const middle = (from + to) / 2, { captures } = state.brief;
  const trip = state.events.filter((e) => e.trip).reduce((near, e) => (!near || Math.abs(e.k - middle) < Math.abs(near.k - middle) ? e : near), null);
  const capture = captures.find((c) => c.id === state.view.capture) ?? captures.at(-1);
  if (by.value === 'trigger' && !capture) {
    state.notice = 'ghost: no capture yet: set the trigger first, or press force';
    return;
  }
  const k = by.value === 'event' && trip ? trip.k : by.value === 'trigger' ? capture.trigger_k : Math.round(middle);
  try {
    const { shift_ticks } = await get('align', { ghost: `run:${run.value}`, by: by.value, k });
    state.ghost = { source: `run:${run.value}`, capture: 0, shift: shift_ticks, by: by.value, label: run.value };
  } catch (error) {
    state.notice = `ghost: ${error.message}`;
    state.ghost = null;
  }
  tell('ghost');
}

export function buildGhost(runs) {
  run = element('select', { id: 'ghost-run' }, element('option', { value: '' }, 'none'), ...runs.map((name) => element('option', { value: name }, name)));
  by = element('select', { id: 'ghost-by' }, ...[['start', 'start'], ['event', 'trip'], ['trigger', 'trigger'], ['angle', 'rotor angle']].map(([value, label]) => element('option', { value }, label)));
  run.onchange = by.onchange = choose;
  byId('ghost').replaceChildren(element('h2', {}, 'Ghost'), element('fieldset', {}, element('label', { htmlFor: 'ghost-run' }, 'run'), run, element('label', { htmlFor: 'ghost-by' }, 'aligned on'), by));
  byId('ghost').hidden = !runs.length;
}

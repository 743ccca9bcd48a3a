// The monitor's findings as cards: what it found, the parameters, the error before and after, what can be done.
import { byId, element, shown } from './dom.js';
import { client, post, trace } from './server.js';
import { show, state, T_s } from './state.js';

const dismissed = new Set();
const KINDS = { model_misfit: 'misfit', effect_proposed: 'proposed', effect_compared: 'compared', nothing_traced: 'gone', effect_taken_back: 'gone' };

const tables = (text) => text.split('\n').filter((line) => !line.startsWith('#')).join('\n').trim();
const sentence = (text) => text.split('\n').filter((line) => line.startsWith('#') && !line.startsWith('# sigma ')).map((line) => line.slice(1).trim()).join(' ') || text;

// The keys of the [[effect]] tables, with the "# sigma KIND.PARAMETER VALUE UNIT" of the comments before them.
function parameters(text) {
  const sigmas = new Map(text.split('\n').filter((line) => line.startsWith('# sigma ')).map((line) => line.split(' ').slice(2)).map(([name, value]) => [name, value]));
  let kind = '';
  const rows = [];
  for (const line of tables(text).split('\n')) {
    const match = line.match(/^\s*(\w+)\s*=\s*([^#]*)/);
    if (!match || match[1] === 'used_in') continue;
    const [, key, value] = match;
    if (key === 'kind') kind = value.trim().replaceAll('"', '');
    const sigma = [...sigmas].find(([name]) => key !== 'kind' && (key === name.slice(kind.length + 1) || key.startsWith(`${name.slice(kind.length + 1)}_`)) && name.startsWith(`${kind}.`));
    const figure = Number(value);
    rows.push([key, Number.isNaN(figure) ? value.trim().replaceAll('"', '') : shown(figure), sigma ? `± ${sigma[1]}` : '']);
  }
  return element('table', {}, ...rows.map(([key, value, sigma]) => element('tr', {}, element('td', {}, key), element('td', {}, value), element('td', { className: 'soft' }, sigma))));
}

async function ask(kind, text, told) {
  try {
    const { replies } = await post('request', { client, kind, text });
    told.textContent = replies.length ? replies.map((r) => (r.accepted ? `${r.role}: ${r.applied_k >= 0 ? `from tick ${r.applied_k} on` : 'yes'}` : `${r.role}: refused, ${r.text}`)).join('; ') : 'no answer in time: the events tell what was applied';
  } catch (error) {
    told.textContent = error.message;
  }
}

// The event with which the estimator took these tables in, if it did not take them out again.
function additionOf(proposal) {
  const plain = (text) => text.replace(/\s+/g, ' ').trim(), wanted = plain(tables(proposal.text));
  const last = state.events.findLast((e) => /effect_(added|removed)/.test(e.reason) && e.role === 'estimator' && plain(tables(e.text)).endsWith(wanted));
  return last?.reason === 'effect_added' ? last : null;
}

// The ticks from the misfit to the proposal that it led to, within what is kept.
function tracedRange(event) {
  const { first_k, last_k } = state.brief;
  const misfit = state.events.findLast((e) => e.reason === 'model_misfit' && e.k < event.k);
  return { from: Math.max(0, first_k, misfit?.k ?? 0), to: Math.min(event.k, last_k) };
}

function card(event, added) {
  const toml = event.reason === 'effect_proposed' ? tables(event.text) : '';
  const told = element('p', { className: 'soft' });
  const buttons = element('div', { className: 'row-buttons' });
  const button = (label, action) => { const b = element('button', {}, label); b.onclick = action; buttons.append(b); };
  button('look', () => show(event.k - 0.5 / T_s(), event.k + 0.5 / T_s()));
  if (toml) button('trace page', () => trace(tracedRange(event), (text) => { told.textContent = text; }));
  if (toml && state.live) {
    if (!added) button('add', () => ask('add_proposed', '', told));
    else button('take off', () => ask('remove_effects', toml, told));
  }
  button('dismiss', () => { dismissed.add(key(event)); refreshFindings(true); });
  const kind = added ? 'added' : KINDS[event.reason];
  return element('div', { className: `card ${kind}` },
    element('p', {}, element('b', {}, `${event.reason.replaceAll('_', ' ')}, ${(event.k * T_s()).toFixed(2)} s${added ? `; in the model from ${(added.k * T_s()).toFixed(2)} s on` : ''}`)),
    element('p', {}, toml ? sentence(event.text) : event.text), ...(toml ? [parameters(event.text)] : []), buttons, told);
}

const key = (event) => `${event.k} ${event.reason} ${event.text}`;

let shownCount = -1;
export function refreshFindings(force = false) {
  if (!force && state.events.length === shownCount) return;
  shownCount = state.events.length;
  const findings = state.events.filter((e) => KINDS[e.reason] && !dismissed.has(key(e)));
  const section = byId('findings');
  section.hidden = !findings.length;
  section.replaceChildren(element('h2', {}, 'Findings of the monitor'), ...findings.slice(-20).reverse().map((e) => card(e, e.reason === 'effect_proposed' && additionOf(e))));
}

// The tree: every field of every channel, with value, unit, rate, and a filter.
import { byId, element, shown } from './dom.js';
import { add } from './plots.js';
import { shortName, state } from './state.js';

const rows = new Map();   // signal -> {row, value}
const groups = new Map(); // channel -> {node, rate}
const OPEN = ['estimate', 'drive'];

function group(name) {
  if (groups.has(name)) return groups.get(name).node;
  const rate = element('span', { className: 'rate' });
  const node = element('details', { open: OPEN.includes(name) }, element('summary', {}, name, rate));
  groups.set(name, { node, rate });
  byId('tree').append(node);
  return node;
}

function makeRow(signal) {
  const value = element('span', { className: 'value' });
  const dot = signal.name.indexOf('.');
  const row = element('div', { className: 'row', draggable: true, title: `${signal.name}\n${signal.comment}`, data: { signal: signal.name } },
    element('span', { className: 'name' }, shortName(signal.name).slice(dot + 1)), value, element('span', { className: 'unit' }, signal.unit));
  row.onclick = () => add(signal.name);
  row.ondragstart = (event) => event.dataTransfer.setData('text/plain', signal.name);
  group(signal.name.slice(0, dot)).append(row);
  rows.set(signal.name, { row, value });
  applyFilter();
}

export function refreshTree(tree) {
  const plotted = new Set(state.layout.plots.flatMap((p) => p.signals.map((s) => s.name)));
  for (const signal of tree.signals) {
    if (!rows.has(signal.name)) makeRow(signal);
    const { row, value } = rows.get(signal.name);
    value.textContent = shown(signal.value);
    row.classList.toggle('shown', plotted.has(signal.name));
  }
  for (const channel of tree.channels) {
    const known = groups.get(channel.channel);
    if (known) known.rate.textContent = state.live ? `${shown(Math.round(channel.rate_Hz))} /s${channel.gaps ? `, ${channel.gaps} gaps` : ''}` : `${channel.messages}`;
  }
}

function applyFilter() {
  const words = byId('filter').value.toLowerCase().split(/\s+/).filter(Boolean);
  for (const { node } of groups.values()) node.hidden = true;
  for (const [name, { row }] of rows) {
    row.hidden = !words.every((word) => name.toLowerCase().includes(word));
    const { node } = groups.get(name.slice(0, name.indexOf('.')));
    if (!row.hidden) node.hidden = false;
    if (words.length && !row.hidden) node.open = true;
  }
}

byId('filter').addEventListener('input', applyFilter);

// The numbers of the time plots: buckets of ticks with their minimum and maximum.
//
// While the page follows the drive, the server streams the buckets that are complete; else they are fetched for the
// range shown. A bucket is a power of two of ticks, and so wide that a plot has one for a pixel.
import { get, numbers, stream } from './server.js';
import { range, state, tell } from './state.js';

const PIXELS = 700;
// tail: what is there of the bucket after `end`, up to tail.end: {end, series: signal -> [min, max]}; null: nothing.
export const feed = { bucket: 1, begin: 0, end: 0, series: new Map(), ghost: new Map(), skipped: 0, tail: null };
let source = null, key = '', drawn = '', fetching = false, again = false, lastFrame = 0, generation = -1;

export function wanted() {
  return [...new Set(state.layout.plots.filter((p) => p.kind === 'time').flatMap((p) => p.signals.map((s) => s.name)))];
}

const bucketOf = (ticks) => 2 ** Math.max(0, Math.ceil(Math.log2(ticks / PIXELS)));
export const sinceFrame_s = () => (performance.now() - lastFrame) / 1000;

// Opens the stream anew if signals or buckets changed. A page that does not follow gets the frames without signals.
export function refresh() {
  const [from, to] = range(), bucket = bucketOf(to - from), signals = wanted();
  const follows = state.view.follow && state.brief.T_s > 0;
  const now = JSON.stringify([follows, follows ? bucket : 0, follows ? signals : [], generation]);
  if (now !== key) {
    key = now;
    if (follows) begin(bucket, signals, from);
    else open({ signals: '', bucket: 1 });
  }
  if (!follows) load();
}

async function begin(bucket, signals, from) {
  drawn = '';
  feed.tail = null;
  const first = Math.max(0, Math.floor(from / bucket) * bucket);
  const end = Math.max(first, Math.floor((state.brief.last_k - 300) / bucket) * bucket);
  const mine = key;
  const rows = await numbers('data', { signals, from: first, to: end, bucket }, 2).catch(() => null);
  if (key !== mine || !state.view.follow) return;
  Object.assign(feed, { bucket, begin: rows ? first : end, end });
  feed.series = new Map(signals.map((s, i) => [s, { min: rows ? [...rows[i][0]] : [], max: rows ? [...rows[i][1]] : [] }]));
  open({ signals: signals.join(','), bucket, from: end });
}

function open(parameters) {
  source?.close();
  source = stream({ ...parameters, events: state.events.length });
  const names = parameters.signals ? parameters.signals.split(',') : [];
  source.onmessage = (message) => take(JSON.parse(message.data), names);
}

function take(frame, names) {
  lastFrame = performance.now();
  const { live, holder, other_holder, new_events, series, begin: first, end, bucket, tail, tail_end, ...brief } = frame;
  if (generation >= 0 && generation !== brief.generation) beginAnew();
  generation = brief.generation;
  Object.assign(state, { brief, live, holder, other_holder });
  if (new_events) {
    state.events.push(...new_events);
    tell('events');
  }
  feed.tail = null;
  if (names.length && bucket === feed.bucket && state.view.follow) {
    append(first, end, series, names);
    if (tail && feed.end === end) feed.tail = { end: tail_end, series: new Map(names.map((name, i) => [name, tail[i]])) };
  }
  if (state.view.follow) state.shown_k = names.length && feed.bucket ? (feed.tail?.end ?? feed.end) - 1 : brief.last_k;
  tell('frame');
  refresh();
}

// Another run of the drive counts its ticks from 0 again; nothing is appended until begin().
function beginAnew() {
  state.events = [];
  if (state.view.capture) state.view = { follow: true, from: 0, to: 0, capture: 0 };
  feed.bucket = feed.begin = feed.end = feed.skipped = 0;
  feed.tail = null;
  for (const s of feed.series.values()) s.min = [], s.max = [];
}

function append(first, end, series, names) {
  if (end <= first) return;
  if (first > feed.end || first < feed.begin) {  // the stream left ticks out: their buckets are empty
    if (feed.end > 0) feed.skipped += Math.max(0, first - feed.end);
    for (const s of feed.series.values()) s.min.length = s.max.length = 0;
    feed.begin = first;
  }
  names.forEach((name, i) => {
    const s = feed.series.get(name);
    const [min, max] = series[i];
    for (let j = 0; j < min.length; ++j) {
      s.min.push(min[j] ?? NaN);
      s.max.push((max.length ? max[j] : min[j]) ?? NaN);
    }
  });
  feed.end = end;
  const [from] = range(), drop = Math.max(0, Math.floor(from / feed.bucket) - feed.begin / feed.bucket - 1);
  if (drop < 64) return;
  for (const s of feed.series.values()) {
    s.min.splice(0, drop);
    s.max.splice(0, drop);
  }
  feed.begin += drop * feed.bucket;
}

// The range of a page that does not follow. A change during the request starts another one.
async function load() {
  const [from, to] = range(), bucket = bucketOf(to - from), signals = wanted();
  const grows = to > state.brief.last_k ? Math.floor(state.brief.last_k / 4096) : 0;
  const now = JSON.stringify([from, to, signals, state.view.capture, generation, grows]);
  if (now === drawn) return;
  if (fetching) { again = true; return; }
  fetching = true;
  const first = Math.max(0, Math.floor(from / bucket) * bucket), end = Math.ceil(to / bucket) * bucket;
  try {
    const rows = await numbers('data', { signals, from: first, to: end, bucket, capture: state.view.capture }, 2);
    if (!state.view.follow) {  // else the stream has taken over meanwhile
      Object.assign(feed, { bucket, begin: first, end });
      feed.series = new Map(signals.map((s, i) => [s, { min: rows[i][0], max: rows[i][1] }]));
      drawn = now;
      tell('loaded');
    }
  } catch (error) {
    state.notice = error.message;
  }
  fetching = false;
  if (again) { again = false; load(); }
}

// The ghost in the same buckets, for the range shown.
export async function loadGhost() {
  if (!state.ghost) { feed.ghost.clear(); return; }
  const { source: name = '', capture = 0, shift } = state.ghost;
  const [from, to] = range(), signals = wanted(), bucket = bucketOf(to - from);
  const first = Math.floor(from / bucket) * bucket, end = Math.ceil(to / bucket) * bucket;
  const begin = Math.max(first, -Math.floor(shift / bucket) * bucket);
  if (end <= begin) return;
  const rows = await numbers('data', { signals, source: name, capture, from: Math.max(0, begin + shift), to: end + shift, bucket }, 2);
  feed.ghost = new Map(signals.map((s, i) => [s, { begin, bucket, min: rows[i][0], max: rows[i][1] }]));
}

export const fetchStatistics = (signals, from, to) =>
  get('statistics', { signals: signals.join(','), from: Math.max(0, from), to, capture: state.view.capture });

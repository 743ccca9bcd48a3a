// The requests of the page (scope/api.hpp lists them).

const token = new URLSearchParams(location.search).get('token');
export const client = crypto.randomUUID ? crypto.randomUUID() : String(Math.random());

function address(path, parameters = {}, folder = '/api/') {
  const query = new URLSearchParams(parameters);
  if (token) query.set('token', token);
  return `${folder}${path}?${query}`;
}

async function answered(response) {
  if (!response.ok) throw new Error((await response.text()).trim() || response.statusText);
  return response;
}

export const get = async (path, parameters) => (await answered(await fetch(address(path, parameters)))).json();

export const post = async (path, body) =>
  (await answered(await fetch(address(path), { method: 'POST', headers: { 'Content-Type': 'application/json' }, body: JSON.stringify(body) }))).json();

// One Float64Array a row: `rows` of them for each signal.
export async function numbers(path, parameters, rows) {
  const signals = parameters.signals;
  if (!signals.length) return [];
  const response = await answered(await fetch(address(path, { ...parameters, signals: signals.join(',') })));
  const all = new Float64Array(await response.arrayBuffer());
  const count = all.length / (signals.length * rows);
  return signals.map((_, i) =>
    Array.from({ length: rows }, (_, r) => all.subarray((i * rows + r) * count, (i * rows + r + 1) * count)));
}

export const download = (path, parameters) => { location.href = address(path, parameters); };

export const stream = (parameters) => new EventSource(address('stream', { ...parameters, client }));

// `twinrate trace` of these ticks, on a page of its own that shows the result once it is there.
export async function trace(range, told) {
  const page = window.open('about:blank', '_blank');  // now: a browser allows it only at the click
  try {
    const { trace: id, directory } = await post('trace', range);
    page.location.href = address('trace', { id }, '/');
    told(`traced in ${directory}`);
  } catch (error) {
    page?.close();
    told(error.message);
  }
}

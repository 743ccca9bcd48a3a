// Drives the page of the scope as a person does, on a drive that this script launches, and takes a picture of each
// state:  node page_test.mjs TWINRATE DIRECTORY [webp]
//
// Says what it claims; exit code 1 at the first claim that does not hold.
import { spawn, spawnSync } from 'node:child_process';
import { mkdirSync, readFileSync, readdirSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { Browser } from './browser.mjs';

const [twinrate, directory, ending = 'png'] = process.argv.slice(2);
mkdirSync(directory, { recursive: true });
process.chdir(directory);
const children = [];
function start(...args) {
  const child = spawn(twinrate, args, { stdio: ['ignore', 'pipe', 'inherit'] });
  children.push(child);
  return child;
}
// Not faster than the wall clock, and few ticks a second: the browser needs the processors, too.
const drive = ['dilys2021', '--set', 'rates.f_s_Hz=2000', '--set', 'estimator.prediction=exact', '--set', 'rates.n=1'];
const launch = (name) => start('launch', ...drive, '--duration', '600s', '--pace', 'wall', '--set', 'reference.omega_e_rad_s=400', '--set', 'bus.peer_timeout_s=60', '--set', 'steering.hold_s=60', '--run-dir', `runs/${name}`);
const picture = async (name) => browser.picture(join(directory, `${name}.${ending}`));
const begun = Date.now();
const told = (text) => console.log(`${((Date.now() - begun) / 1000).toFixed(1)} s: ${text}`);
const claim = (text, holds) => { if (!holds) throw new Error(`does not hold: ${text}`); told(text); };
const value = (expression) => browser.evaluate(expression);

// A hash alone would not load the page anew.
async function go(url) {
  await browser.send('Page.navigate', { url: 'about:blank' });
  await browser.send('Page.navigate', { url }).catch(() => {});  // the page is waited for
}

// The place of a value in the first plot, on the left axis.
const inFirstPlot = (y) => value(`(() => { const o = document.querySelector('.plot .u-over').getBoundingClientRect(); return [o.left + 0.6 * o.width, o.top + o.height * ${y}]; })()`);

const asAddress = (layout) => Buffer.from(JSON.stringify(layout)).toString('base64url');

async function withoutADrive() {
  const layout = { window_s: 5, plots: [{ kind: 'time', signals: [{ name: 'truth.omega_m_rad_s', axis: 'l' }, { name: 'truth.T_em_Nm', axis: 'r' }] }] };
  await go(`${address}#layout=${asAddress(layout)}`);
  await browser.until('a layout of an address loads without data', "document.querySelectorAll('.plot canvas').length === 1 && document.querySelectorAll('.plot .chip').length === 2 && document.querySelector('#window').value === '5'");
  writeFileSync('layout.json', JSON.stringify({ window_s: 1, plots: [...layout.plots, { kind: 'xy', signals: [{ name: 'truth.i_d_A', axis: 'l' }, { name: 'truth.i_q_A', axis: 'l' }] }] }));
  const { root } = await browser.send('DOM.getDocument');
  const { nodeId } = await browser.send('DOM.querySelector', { nodeId: root.nodeId, selector: '#import-layout' });
  await browser.send('DOM.setFileInputFiles', { nodeId, files: [join(directory, 'layout.json')] });
  await browser.until('a layout of a file does, too', "document.querySelectorAll('.plot').length === 2 && document.querySelector('#window').value === '1'");
  await value("document.querySelector('#default-layout').click()");
}

async function curves() {
  await browser.until('it says that no drive is heard', "document.querySelector('#notice').textContent.includes('No drive heard')");
  const set = launch('live');
  await browser.until('curves without a click', "scope.feed.series.get('estimate.omega_m_rad_s')?.max.some((v) => v > 50)");
  await browser.until('the events are listed', "document.querySelectorAll('#events li').length > 0 || scope.state.brief.first_k > 1");
  await browser.until('the page is live', "document.querySelector('#lamp').textContent === 'live'");
  await browser.until('a second of the drive', 'scope.state.brief.last_k > 2000');
  await picture('run');
  return set;
}

async function treeAndLayout() {
  await browser.type('#filter', 'i_alpha');
  await value("document.querySelector('#filter').dispatchEvent(new Event('input'))");
  await browser.click('#tree .row[data-signal="drive.i_alpha_A"]');
  await browser.until('a click in the tree plots the signal', "scope.state.layout.plots[0].signals.some((s) => s.name === 'drive.i_alpha_A')");
  await browser.until('the layout is in the address', "location.hash.startsWith('#layout=')");
  await browser.send('Page.reload').catch(() => {});
  await browser.until('a layout survives a reload', "scope.state.layout.plots[0].signals.some((s) => s.name === 'drive.i_alpha_A')");
  await value("[...document.querySelectorAll('.plot .chip')].find((c) => c.textContent.includes('i_alpha')).querySelector('.x').click()");
}

// The plots as their signals, with ">" for the right axis.
const plots = () => value("scope.state.layout.plots.map((p) => p.signals.map((s) => s.name + (s.axis === 'r' ? '>' : '')).join(' '))");
const plotPlace = (n, fx) => value(`(() => { const b = document.querySelectorAll('.plot')[${n}].getBoundingClientRect(); return [b.left + ${fx} * b.width, b.top + 0.5 * b.height]; })()`);

async function dragsOfPlots() {
  const row = '#tree .row[data-signal="drive.i_beta_A"]', first = await plots();
  await browser.type('#filter', 'i_beta');
  await value("document.querySelector('#filter').dispatchEvent(new Event('input'))");
  await browser.until('the tree has the signal', `document.querySelector(${JSON.stringify(row)}) && !document.querySelector(${JSON.stringify(row)}).hidden`);
  await browser.drop(row, await plotPlace(1, 0.9));
  await browser.until('a signal dropped on the right half is on the right axis', `scope.state.layout.plots[1].signals.some((s) => s.name === 'drive.i_beta_A' && s.axis === 'r')`);
  await value("[...document.querySelectorAll('.plot')[1].querySelectorAll('.tools button')].find((b) => b.textContent === 'split').click()");
  const split = await plots();
  claim(`split gives each signal a plot of its own: ${split.slice(1, 4).join(', ')}`, split.slice(1, 4).join() === [...first[1].split(' ').map((s) => s.replace('>', '')), 'drive.i_beta_A'].join());
  await browser.drop('.plot:nth-child(3) .bar .hint', await plotPlace(0, 0.5));
  const moved = await plots();
  claim(`a plot dropped on another one takes its place: ${moved.slice(0, 2)}`, moved[0] === split[2] && moved[1] === split[0]);
  await value("document.querySelector('#default-layout').click()");
  await browser.type('#filter', '');
  await value("document.querySelector('#filter').dispatchEvent(new Event('input'))");
}

const settings = async (fields) => { for (const [name, text] of Object.entries(fields)) await browser.type(`#trigger-${name}`, text); };
const choose = (name, option) => value(`void (document.querySelector('#trigger-${name}').value = '${option}', document.querySelector('#trigger-${name}').dispatchEvent(new Event('change')))`);
const mode = (name) => browser.until(`the mode is ${name}`, `scope.state.brief.trigger.mode === '${name}'`);
const captured = () => value('scope.state.brief.captures.at(-1)?.id ?? 0');
const capturesAfter = (id) => value(`scope.state.brief.captures.filter((c) => c.id > ${id})`);
const until = async (claimed, id, count) => browser.until(claimed, `scope.state.brief.captures.filter((c) => c.id > ${id}).length >= ${count}`);

async function triggers() {
  await browser.click('#follow');
  await settings({ source: 'estimate.omega_m_rad_s', level: '1e6', length_s: '0.02', hysteresis: '0' });
  let id = await captured();
  await browser.click('#trigger-auto');
  await until('auto captures without a trigger', id, 2);
  claim('and says so', (await capturesAfter(id)).every((c) => c.cause === 'no trigger: by itself'));
  await browser.click('#trigger-normal');
  await mode('normal');
  id = await captured();
  const at = await value('scope.state.brief.last_k');
  await browser.until('2000 ticks', `scope.state.brief.last_k > ${at + 2000}`);
  claim('normal does not', await captured() === id);
  await browser.click('#trigger-force');
  await until('force captures at once', id, 1);
  claim('and says so', (await capturesAfter(id))[0].cause === 'forced');
  // The current turns through 0 with every electrical turn.
  await settings({ hysteresis: '100', level: '0', source: 'measurement.i_a_A' });
  id = await captured();
  const still = await value('scope.state.brief.last_k');
  await browser.until('another 1000 ticks', `scope.state.brief.last_k > ${still + 1000}`);
  claim('a hysteresis above the amplitude keeps the trigger from firing', await captured() === id);
  await browser.click('#trigger-stop');
  await mode('stop');
  await settings({ hysteresis: '0.02', holdoff_s: '0.1', pre_percent: '25' });
  id = await captured();
  await browser.click('#trigger-normal');
  await until('a smaller one does not', id, 3);
  const held = await capturesAfter(id);
  claim(`the pre-trigger is 25 % of 40 ticks: ${held[0].trigger_k - held[0].from}`, held.every((c) => c.trigger_k - c.from === 10 && c.to - c.from === 40));
  claim(`a hold-off of 0.1 s is kept: ${held.slice(1).map((c, i) => c.trigger_k - held[i].trigger_k)}`, held.slice(1).every((c, i) => c.trigger_k - held[i].trigger_k >= 230));
  await browser.click('#trigger-stop');
  await mode('stop');
  id = await captured();
  await browser.click('#trigger-single');
  await until('single captures', id, 1);
  await mode('stop');
  claim('once', (await capturesAfter(id)).length === 1);
  // The level as a line: dragged by the mouse, it is the level of the trigger.
  await settings({ source: 'estimate.omega_m_rad_s', hysteresis: '0', holdoff_s: '0', pre_percent: '50', level: '100' });
  await browser.until('the plot shows the level', `${levelRow} > 0`);
  const [left, top, width] = await value("(() => { const o = document.querySelector('.plot canvas').getBoundingClientRect(); return [o.left, o.top, o.width]; })()");
  const x = left + 0.4 * width, y = top + await value(levelRow);
  await browser.drag([x, y], [x, y + 10]);
  const dragged = Number(await value("document.querySelector('#trigger-level').value"));
  claim(`the level is dragged in the plot: 100 to ${dragged}`, dragged < 100 && dragged > 50);
  claim('a drag of the level zooms nothing', await value('scope.state.view.follow'));
  await browser.click('#trigger-normal');
  await browser.until('the trigger has the dragged level', `scope.state.brief.trigger.level === ${dragged}`);
  await browser.click('#trigger-stop');
  await mode('stop');
}

// The row of the first plot with most pixels of the level's colour, or of its blends with white.
const levelRow = `(() => {
  const canvas = document.querySelector('.plot canvas'), { width, height } = canvas, { data } = canvas.getContext('2d').getImageData(0, 0, width, height);
  let best = 0, most = 50;
  for (let y = 0; y < height; ++y) {
    let count = 0;
    for (let x = 0; x < width; ++x) { const i = 4 * (y * width + x); count += data[i] > data[i + 1] + 40 && data[i + 1] > data[i + 2]; }
    if (count > most) most = count, best = y;
  }
  return best;
})()`;

async function trigger() {
  await browser.type('#trigger-source', 'estimate.omega_m_rad_s');
  await browser.type('#trigger-length_s', '0.05');
  await browser.type('#trigger-level', '100');
  await browser.until('the plot has its range', "scope.feed.series.get('estimate.omega_m_rad_s').max.length > 20");
  await value("document.querySelector('#window').value = '0.2'; document.querySelector('#window').dispatchEvent(new Event('change'))");
  await browser.click('#trigger-normal');
  await browser.until('three captures', 'scope.state.brief.captures.length >= 3');
  await browser.click('#trigger-stop');
  await browser.until('the list stands still', "scope.state.brief.trigger.mode === 'stop' && document.querySelectorAll('#captures li').length === scope.state.brief.captures.length");
  await browser.click('#captures li:nth-child(1) .what');
  await browser.until('a capture shows every tick', 'scope.state.view.capture > 0 && scope.feed.bucket === 1');
  claim('no tick of it is missing', await value('scope.state.brief.captures.every((c) => c.missing === 0)'));
  await browser.until('another one can be laid over it', "document.querySelector('#captures li.on') && !document.querySelector('#captures li:not(.on) button').disabled");
  await browser.click('#captures li:not(.on) button');
  await browser.until('another capture lies behind it', 'scope.feed.ghost.size > 0');
  await picture('trigger');
}

// A tick from which on thousands are there, however long the machine took so far.
const kept = () => value('Math.max(2000, scope.state.brief.last_k - 20000)');

async function zoomAndCursors() {
  await browser.click('#follow');  // off the capture
  const base = await kept();
  await value(`scope.show(${base}, ${base + 400})`);
  await browser.until('the range is drawn', `scope.feed.begin <= ${base} && scope.feed.end >= ${base + 400} && scope.feed.bucket === 1 && scope.feed.series.get('estimate.omega_m_rad_s')?.max.some((v) => v > 50)`);
  const [x, y] = await inFirstPlot(0.5), width = await value("document.querySelector('.plot .u-over').getBoundingClientRect().width");
  // Again where the page was still at work.
  for (let i = 0; i < 5 && !await value(`scope.state.view.from > ${base}`); ++i) {
    await browser.drag([x, y], [x + 60, y]);
    await browser.until('the page has drawn', 'new Promise((go) => requestAnimationFrame(() => requestAnimationFrame(() => go(true))))');
  }
  await browser.until('a drag zooms in', `scope.state.view.from > ${base}`);
  const { from, to } = await value('scope.state.view');
  claim(`to what was dragged over: ${from} to ${to}`, Math.abs(from - base - 240) < 8 && Math.abs(to - from - 400 * 60 / width) < 8);
  await browser.key('c', 'KeyC');
  await browser.until('the cursors tell dt', "/dt .* ms/.test(document.querySelector('#readout').textContent)");
  await browser.until('the visible range has its figures and the cursors their difference', "/signal.*min.*max.*mean.*rms.*peak to peak.*A.*B.*B − A/.test(document.querySelector('#statistics tr')?.textContent)");
  const [row, ticks] = await value("(() => [[...document.querySelectorAll('#statistics tr')].find((r) => r.firstChild.textContent === 'estimate.omega_m_rad_s').textContent && [...[...document.querySelectorAll('#statistics tr')].find((r) => r.firstChild.textContent === 'estimate.omega_m_rad_s').children].map((c) => c.textContent), scope.state.cursors])()");
  const [min, max, mean, rms, peak, atA, atB, dy] = row.slice(1, 9).map(Number);
  const samples = await value(`(async () => [...new Float64Array(await (await fetch('/api/samples?signals=estimate.omega_m_rad_s&from=${from}&to=${to}')).arrayBuffer())])()`);
  const near = (a, b) => Math.abs(a - b) <= 2e-4 * Math.max(...samples.map(Math.abs));
  claim(`they are those of the ticks: ${row}`, near(min, Math.min(...samples)) && near(max, Math.max(...samples)) && near(mean, samples.reduce((x, y) => x + y) / samples.length) && near(rms, Math.hypot(...samples) / Math.sqrt(samples.length)) && near(peak, max - min) && near(atA, samples[ticks.a - from]) && near(atB, samples[ticks.b - from]) && near(dy, atB - atA));
  await browser.key('c', 'KeyC');
}

async function exports() {
  const csv = await value("(async () => { const names = ['measurement.i_a_A', 'estimate.omega_m_rad_s']; return (await fetch(`/api/csv?from=2000&to=2400&signals=${names}`)).text(); })()");
  const lines = csv.trim().split('\n');
  claim('the visible range as CSV has every tick and its names', lines[0] === 'k,t_s,measurement.i_a_A,estimate.omega_m_rad_s' && lines.length === 401 && lines[400].startsWith('2399,'));
  await value('void (window.made = [], URL.createObjectURL = ((make) => (blob) => { made.push(blob); return make.call(URL, blob); })(URL.createObjectURL))');
  await value("document.querySelector('#export-png').click()");
  await browser.until('the plots are a picture', "made.some((b) => b.type === 'image/png' && b.size > 5000)");
}

// A page that is opened is noted.
const keepTabs = () => value('void (window.open = () => (window.tab = { location: {}, close() {} }))');

async function traceOfTheRange() {
  const base = await kept();
  await value(`scope.show(${base}, ${base + 2000})`);
  await keepTabs();
  await value("document.querySelector('#trace').click()");
  await browser.until('the trace has a page', "window.tab?.location.href?.startsWith('/trace?id=')");
  await browser.until('the page of the trace shows its result', "fetch(tab.location.href).then((r) => r.text()).then((text) => text.includes('What the model of dilys2021 lacks'))");
}

async function otherAxes() {
  const plot = (kind, ...names) => ({ kind, signals: names.map((name) => ({ name, axis: 'l' })) });
  const layout = { window_s: 0.5, plots: [plot('xy', 'drive.i_alpha_A', 'drive.i_beta_A'), plot('xy', 'truth.i_d_A', 'truth.i_q_A'), plot('angle', 'truth.T_em_Nm'), plot('spectrum', 'measurement.i_a_A'), plot('orders', 'truth.omega_m_rad_s', 'estimate.omega_m_rad_s'), plot('xy', 'truth.omega_m_rad_s', 'truth.T_em_Nm')] };
  const hash = Buffer.from(JSON.stringify(layout)).toString('base64url');
  await go(`${address}#layout=${hash}`);
  await browser.until('a layout of an address is drawn', "document.querySelectorAll('.plot canvas').length === 6 && document.querySelectorAll('#tree .row').length > 20");
  await picture('xy');
  await go(address);
  await browser.until('the page is there', 'scope.feed !== undefined');
  await value("document.querySelector('#default-layout').click()");
}

async function ghost() {
  await browser.until('the page follows', "scope.feed.series.get('estimate.omega_m_rad_s')?.max.length > 20");
  await value("document.querySelector('#ghost-run').value = 'before'; document.querySelector('#ghost-run').dispatchEvent(new Event('change'))");
  await value('scope.show(0, 4000)');
  await browser.until('it is aligned on the start', "scope.state.ghost?.by === 'start' && scope.state.ghost.shift === 0");
  await browser.until('a run lies behind the drive', "[...(scope.feed.ghost.get('truth.omega_m_rad_s')?.max ?? [])].some((v) => v > 150)");
  await browser.until('the drive is drawn', "scope.feed.series.get('truth.omega_m_rad_s').max.length > 200");
  await value('new Promise((go) => requestAnimationFrame(() => requestAnimationFrame(go)))');
  await picture('ghost');
  await value("document.querySelector('#ghost-by').value = 'trigger'; document.querySelector('#ghost-by').dispatchEvent(new Event('change'))");
  await browser.until('it can be aligned on the trigger', 'scope.state.ghost.by === "trigger"');
  const around = await value("(async () => { const k = scope.state.brief.captures.at(-1).trigger_k + scope.state.ghost.shift; return [...new Float64Array(await (await fetch(`/api/samples?source=run:before&signals=estimate.omega_m_rad_s&from=${k - 1}&to=${k + 1}`)).arrayBuffer())]; })()");
  claim(`to the tick at which it crosses the level: ${around}`, around[0] < 100 && around[1] >= 100);
  await value('scope.show(100, 300)');  // it turns there
  await value("document.querySelector('#ghost-by').value = 'angle'; document.querySelector('#ghost-by').dispatchEvent(new Event('change'))");
  await browser.until('it can be aligned on the rotor angle', 'scope.state.ghost.by === "angle"');
  const [angle, ghostAngle, step] = await value("(async () => { const [from, to] = [scope.state.view.from, scope.state.view.to], k = Math.round((from + to) / 2), read = async (source, tick) => new Float64Array(await (await fetch(`/api/samples?source=${source}&signals=measurement.theta_m_rad&from=${tick}&to=${tick + 2}`)).arrayBuffer()); const mine = await read('', k), other = await read('run:before', k + scope.state.ghost.shift); return [mine[0], other[0], other[1] - other[0]]; })()");
  const off = Math.abs(angle - ghostAngle - 2 * Math.PI * Math.round((angle - ghostAngle) / (2 * Math.PI)));
  claim(`to the tick with the angle in the middle of the view: ${off.toFixed(4)} rad beside it, ${step.toFixed(4)} rad a tick`, step > 0.05 && off <= 0.6 * step);
  await value("document.querySelector('#ghost-run').value = 'faster'; document.querySelector('#ghost-run').dispatchEvent(new Event('change'))");
  await browser.until('a run at another rate is refused', "document.querySelector('#notice').textContent.includes('the ghost has f_s = 5000 Hz, the drive 2000 Hz')");
  await value("document.querySelector('#ghost-run').value = ''; document.querySelector('#ghost-run').dispatchEvent(new Event('change'))");
  await browser.click('#follow');
}

// A request from the page and what the page says of it.
const clearTold = () => value("void (document.querySelector('#steering-told').textContent = '')");
const answered = (what, text) => browser.until(`the page says of ${what}: ${text}`, `${text}.test(document.querySelector('#steering-told').textContent)`);
async function enter(key, text, expected) {
  await clearTold();
  await browser.type(`[name=${key}]`, text);
  await browser.key('Enter');
  await answered(`${key}=${text}`, expected);
}
async function pick(key, option, expected) {
  await clearTold();
  await value(`void (document.querySelector('[name=${key}]').value = '${option}', document.querySelector('[name=${key}]').dispatchEvent(new Event('change')))`);
  await answered(`${key}=${option}`, expected);
}
// The trigger waits for an event; what it caught says so.
async function armed(source) {
  await settings({ source, length_s: '0.05', holdoff_s: '0', pre_percent: '50' });
  await browser.click('#trigger-single');
  await browser.until(`armed on ${source}`, "scope.state.brief.trigger.mode === 'single'");
}
const caught = (what, cause) => browser.until(`the trigger caught ${what}`, `scope.state.brief.captures.at(-1)?.cause === '${cause}'`);

async function steering() {
  claim('it is watch-only at first', await value("document.querySelector('[data-kind=start]').disabled"));
  await browser.click('#take-control');
  await browser.until('control is taken', "!document.querySelector('[data-kind=reset]').disabled");
  await browser.until('the limits of the drive file stand beside the inputs', "document.querySelector('[name=speed_rpm]').parentNode.textContent.includes('-4000.2 to 4000.2')");
  claim('another page is refused', await value("fetch('/api/control', { method: 'POST', body: JSON.stringify({ client: 'another', take: true }) }).then((r) => r.text())") === 'another page has the control\n');
  await armed('event: reference step');
  await enter('speed_rpm', '900', /speed_rpm|plant from tick \d+ on/);
  await caught('a step of the reference', 'reference.omega_m_ref_rad_s change');
  for (const [key, text] of [['omega_e_rad_s', '400'], ['load_Nm', '0.002'], ['n', '3']]) await enter(key, text, /plant from tick \d+ on/);
  await enter('load_Nm', '1000', /refused, load_Nm=1000: -.* allowed/);
  await pick('policy', 'rotor_frame', /plant from tick \d+ on/);
  await pick('compensation', 'paper', /refused, .*needs an estimator.kind that estimates the load/);
  await browser.until('a choice that was refused is not shown', "document.querySelector('[name=compensation]').value === ''");
  for (const kind of ['stop', 'start']) {
    await clearTold();
    await browser.click(`[data-kind=${kind}]`);
    await answered(kind, /plant from tick \d+ on/);
  }
  const friction = '[[effect]]\nkind = "coulomb_friction"\ntorque_Nm = 0.0001\nused_in = "model"\n';
  await value("document.querySelector('#steering details').open = true");
  await value(`void (document.querySelector('#steering textarea').value = ${JSON.stringify(friction)})`);
  await armed('event: effect_added');
  for (const [label, text] of [['add', 'effect_added'], ['take off', 'effect_removed']]) {
    await clearTold();
    await value(`[...document.querySelectorAll('#steering details button')].find((b) => b.textContent === '${label}').click()`);
    await answered(label, /estimator from tick \d+ on/);
    await browser.until(`the log tells of it: ${text}`, `scope.state.events.some((e) => e.reason === '${text}')`);
  }
  await caught('an effect that is added', 'event effect_added');
  await value("document.querySelector('#steering details').open = false");
  await picture('steering');
  await browser.click('#whole');  // another stream
  await value('void (window.frameBefore = scope.state.brief)');
  await browser.until('the other stream tells', 'scope.state.brief !== frameBefore');
  claim('control outlives a change of the view', await value("!document.querySelector('[data-kind=reset]').disabled"));
  await armed('event: trip');
  await browser.key('Escape');
  await browser.until('Esc stops the drive', "scope.state.events.some((e) => e.reason === 'emergency_stop')");
  await browser.until('the page says what the drive is in', "document.querySelector('#mode').textContent === 'SAFE: emergency stop'");
  await caught('a trip', 'event emergency_stop');
  await browser.click('#events li.trip');
  await browser.until('a click on a fault shows the ticks before it, with nothing armed', "(() => { const e = scope.state.events.findLast((e) => e.trip), { view } = scope.state; return !view.follow && view.capture === 0 && view.from < e.k && view.to > e.k && scope.feed.begin <= view.from + 2 * scope.feed.bucket && scope.feed.series.get('estimate.omega_m_rad_s')?.max[10] > 50; })()");
  await browser.click('#follow');
  await picture('emergency-stop');
  await clearTold();
  await browser.click('[data-kind=reset]');
  await answered('reset', /from tick \d+ on/);
  await browser.until('the drive runs again', "document.querySelector('#mode').textContent === 'run'");
  const stops = await value("scope.state.events.filter((e) => e.reason === 'emergency_stop').length");
  await browser.click('#take-control');
  await browser.until('the control is given back', "document.querySelector('[data-kind=reset]').disabled");
  await browser.click('#estop');
  await browser.until('the red button stops the drive without control', `scope.state.events.filter((e) => e.reason === 'emergency_stop').length > ${stops}`);
}

// The processes of a set: their parent is launch.
const setOf = (drive) => readdirSync('/proc').filter((pid) => /^\d+$/.test(pid)).filter((pid) => {
  try {
    return readFileSync(`/proc/${pid}/stat`, 'utf8').split(') ').at(-1).split(' ')[1] === String(drive.pid);
  } catch { return false; }  // it has ended
});

async function lost(drive) {
  const set = setOf(drive);
  claim(`the set has its processes: ${set.length}`, set.length >= 5);
  set.forEach((pid) => process.kill(Number(pid), 'SIGSTOP'));
  await browser.until('a lost bus is told', "document.querySelector('#lamp').textContent === 'lost' && document.querySelector('#notice').textContent.includes('Nothing heard')");
  await picture('lost');
  set.forEach((pid) => process.kill(Number(pid), 'SIGCONT'));
  await browser.until('the page goes on with the drive', "document.querySelector('#lamp').textContent === 'live'");
  drive.kill('SIGINT');
  await browser.until('the end of a run is told', "document.querySelector('#lamp').textContent === 'ended' && document.querySelector('#notice').textContent.includes('has ended')");
  await armed('event: model_misfit');  // it waits for the next run
  start('launch', 'finding.toml', '--monitor', '--duration', '600s', '--pace', 'wall', '--run-dir', 'runs/again');
  await browser.until('the page recovers by itself', "document.querySelector('#lamp').textContent === 'live' && scope.state.brief.last_k > 100");
  await browser.until('with the curves of the new run', "scope.feed.end <= scope.state.brief.last_k + 1 && scope.feed.series.get('estimate.omega_m_rad_s')?.max.some((v) => v > 1)");
}

// A run that has ended, on a page of its own; another one behind it.
async function past() {
  const scope = start('scope', 'runs/live', '--port', '0');
  const url = await new Promise((found) => scope.stdout.once('data', (text) => found(String(text).match(/http:\S+/)[0])));
  await go(url);
  await browser.until('a run directory opens on the same page', "document.querySelector('#lamp').textContent === 'run' && scope.feed.series.get('truth.omega_m_rad_s')?.max.some((v) => v > 50)");
  claim('without a panel that steers', await value("document.querySelector('#steering').hidden && document.querySelector('#estop').hidden"));
  await browser.click('#events li.trip');
  await browser.until('a click on its event jumps there', "(() => { const e = scope.state.events.findLast((e) => e.trip), { view } = scope.state; return view.from < e.k && view.to > e.k && view.to - view.from < scope.state.brief.last_k / 2; })()");
  await value("document.querySelector('#ghost-run').value = 'before'; document.querySelector('#ghost-by').value = 'event'; document.querySelector('#ghost-by').dispatchEvent(new Event('change'))");
  await browser.until('another run lies behind it, trip on trip', "scope.state.ghost?.by === 'event' && scope.feed.ghost.get('truth.omega_m_rad_s')?.max.some((v) => v > 50)");
}

// Speed and load vary; a dead time begins that the model does not have.
const varied = (values) => Array.from({ length: 200 }, (_, i) => `[${i / 2}, ${values[i % values.length]}]`);
writeFileSync('finding.toml', `preset = "niewiara2020"
rates.f_s_Hz = 4000
controller.kind = "foc"
controller.angle_source = "measured"
controller.foc = { compensate_effects = true, speed_bandwidth_Hz = 15 }
reference = { speed_rpm = [${varied([150, 250, 200, 300])}], slew_rad_s2 = 300 }
load = { T_load_Nm = [${varied([1, 2.5, 1.5, 3])}], slew_Nm_s = 15 }
run.settle_s = 0.4
monitor = { learn_s = 0.5, block_s = 0.1, gather_s = 1 }
effect = [{ kind = "dead_time", dead_time_s = 4e-6, used_in = "plant", from_s = 1 }]
`);

async function finding() {
  const button = (label) => `[...document.querySelectorAll('#findings .card button')].find((b) => b.textContent === '${label}')`;
  const press = (label) => value(`${button(label)}.click()`);
  await caught('a misfit', 'event model_misfit');
  claim('the fields have nothing of the run before', await value("[...document.querySelectorAll('#steering .settings input, #steering .settings select')].every((n) => n.value === '')"));
  await browser.until('the monitor proposes the effect', "scope.state.events.some((e) => e.reason === 'effect_proposed')");
  await browser.click('#take-control');
  await browser.until('the page has the control', "!document.querySelector('[data-kind=reset]').disabled");
  await press('add');
  await browser.until('the effect is in the model', "document.querySelector('#findings .added b').textContent.includes('in the model from')");
  await picture('finding');
  await keepTabs();
  await press('trace page');
  await browser.until('the finding has a trace page', "tab.location.href && fetch(tab.location.href).then((r) => r.text()).then((text) => /Tracing niewiara2020|What the model of niewiara2020 lacks/.test(text))");
  await press('take off');
  await browser.until('the effect is out of the model', `scope.state.events.some((e) => e.reason === 'effect_removed') && ${button('add')}`);
  const cards = await value("document.querySelectorAll('#findings .card').length");
  await press('dismiss');
  claim('a finding is dismissed', await value("document.querySelectorAll('#findings .card').length") < cards);
}

let browser, address, failed = 0;
try {
  const simulate = (name, ...more) => spawnSync(twinrate, ['simulate', ...more, '--duration', '1s', '--set', 'run.settle_s=0.5', '--set', 'reference.omega_e_rad_s=800', '--run-dir', `runs/${name}`]);
  simulate('before', ...drive);
  simulate('faster', 'dilys2021');
  const scope = start('scope', '--port', '0');
  address = await new Promise((found) => scope.stdout.once('data', (text) => found(String(text).match(/http:\S+/)[0])));
  browser = await Browser.open(address);
  await withoutADrive();
  const set = await curves();
  for (const part of [treeAndLayout, dragsOfPlots, triggers, trigger, zoomAndCursors, exports, traceOfTheRange, otherAxes, ghost, steering]) {
    told(part.name);
    await part();
  }
  await lost(set);
  told('finding');
  await finding();
  told('past');
  await past();
  claim(`no error of the page: ${browser.errors}`, !browser.errors.length);
} catch (error) {
  told(error.message);
  console.log(`errors of the page: ${browser?.errors.join('\n')}`);
  const state = "JSON.stringify([scope.state.view, scope.state.brief, scope.state.cursors, scope.state.notice, document.querySelector('#notice').textContent, document.activeElement.id, document.querySelector('#readout').textContent, document.querySelector('#steering-told').textContent])";
  console.log(`state of the page: ${await browser?.evaluate(state, 5).catch((e) => e.message)}`);
  await picture('failed').catch(() => {});
  failed = 1;
}
children.forEach((child) => child.kill('SIGKILL'));
await browser?.close();
process.exit(failed);

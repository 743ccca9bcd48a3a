// What the page of the scope does on this machine, in a headless Chromium:
//
//   node bench/scope_page.mjs TWINRATE DIRECTORY [first] [smooth] [captures] [clicks]
//
//   first     seconds from the printed address to the first curves, the browser being open
//   smooth    frames/s of 16 signals of 10 kHz over 60 s
//   captures  100 triggered captures at 10 kHz against the log of the run
//   clicks    1000 requests: Enter in the field of the load, clicks of start and stop. From the key or click to the
//             answer with its tick; whether all processes applied each at one tick; the replay of the log
import { spawn, spawnSync } from 'node:child_process';
import { mkdirSync, readFileSync, rmSync } from 'node:fs';
import { cpus, loadavg } from 'node:os';
import { dirname, join } from 'node:path';
import { fileURLToPath } from 'node:url';
import { Browser } from '../tests/scope/browser.mjs';

const [twinrate, directory, ...wanted] = process.argv.slice(2);
const requests = join(dirname(fileURLToPath(import.meta.url)), '../build/bench/steering_requests');
rmSync(join(directory, 'runs'), { recursive: true, force: true });
mkdirSync(directory, { recursive: true });
process.chdir(directory);
const told = (text) => console.log(text);
const wait = (ms) => new Promise((go) => setTimeout(go, ms));

async function launch(name, ...more) {
  const set = spawn(twinrate, ['launch', 'dilys2021', '--duration', 'inf', '--pace', 'wall', '--scope', '--scope-port', '0', '--run-dir', `runs/${name}`, ...more], { stdio: ['ignore', 'pipe', 'inherit'] });
  launched.push(set);
  let text = '';
  set.stdout.on('data', (piece) => { text += piece; });
  while (!/http:\S+/.test(text)) await wait(1);
  return { set, address: text.match(/http:\S+/)[0], text: () => text };
}

// Whatever fails, no drive runs on.
const launched = [];
process.on('exit', () => launched.forEach((set) => set.kill('SIGINT')));
const ended = ({ set }) => new Promise((gone) => { set.once('exit', gone); set.kill('SIGINT'); });
const fast = ['--set', 'rates.f_s_Hz=10000', '--set', 'reference.omega_e_rad_s=400'];
// Every plot over time has a curve that was drawn.
const CURVES = "[...document.querySelectorAll('.plot')].length >= 6 && ['truth.omega_m_rad_s', 'estimate.omega_m_rad_s', 'drive.angle_error_rad', 'truth.i_q_A', 'drive.u_q_V', 'truth.T_load_Nm'].every((n) => scope.feed.series.get(n)?.max.some((v) => !Number.isNaN(v)))";

async function first() {
  const browser = await Browser.open('about:blank');
  const seconds = [];
  for (let i = 0; i < 5; ++i) {
    const drive = await launch(`first${i}`);
    const begun = performance.now();
    await browser.send('Page.navigate', { url: drive.address });
    await browser.until('curves', CURVES, 30);
    await browser.evaluate('new Promise((go) => requestAnimationFrame(() => requestAnimationFrame(go)))');
    seconds.push((performance.now() - begun) / 1000);
    await browser.send('Page.navigate', { url: 'about:blank' });
    await ended(drive);
  }
  await browser.close();
  told(`first curves after ${seconds.map((s) => s.toFixed(2)).join(', ')} s`);
}

const SIXTEEN = ['reference.omega_m_ref_rad_s', 'truth.omega_m_rad_s', 'estimate.omega_m_rad_s', 'drive.angle_error_rad', 'measurement.i_a_A', 'measurement.i_b_A', 'measurement.i_c_A', 'truth.i_d_A', 'truth.i_q_A', 'estimate.i_d_A', 'estimate.i_q_A', 'drive.u_d_V', 'drive.u_q_V', 'drive.u_abs_V', 'truth.T_em_Nm', 'estimate.x_hat[3]'];

async function smooth() {
  const drive = await launch('smooth', ...fast);
  const plots = [0, 4, 8, 12].map((i) => ({ kind: 'time', signals: SIXTEEN.slice(i, i + 4).map((name) => ({ name, axis: 'l' })) }));
  const hash = Buffer.from(JSON.stringify({ window_s: 60, plots })).toString('base64url');
  const browser = await Browser.open(`${drive.address}#layout=${hash}`);
  await browser.until('60 s of the drive', 'scope.state.brief.last_k > 600000', 400);
  await browser.evaluate("void (window.drawn = 0, window.ticks = [], (f => { uPlot.prototype.setData = f })(uPlot.prototype.setData), [...document.querySelectorAll('.plot')].length)");
  // A frame: the newest bucket moved and the canvases were drawn. draw() calls setScale of the first chart once.
  const frames = await browser.evaluate(`new Promise((done) => {
    const begun = performance.now(); let frames = 0, longest = 0, last = begun, seen = -1;
    const look = () => {
      const now = performance.now(), k = scope.state.shown_k;
      if (k !== seen) { seen = k; ++frames; longest = Math.max(longest, now - last); last = now; }
      if (now - begun < 10000) requestAnimationFrame(look); else done([frames / (now - begun) * 1000, longest]);
    };
    requestAnimationFrame(look);
  })`, 30);
  const drawn = await browser.evaluate("new Promise((done) => { const canvas = document.querySelector('.plot canvas'), context = canvas.getContext('2d'), stroke = context.clearRect.bind(context); let n = 0; context.clearRect = (...a) => { ++n; stroke(...a); }; setTimeout(() => { delete context.clearRect; done(n / 10); }, 10000); })", 30);
  const text = await browser.evaluate("document.querySelector('#decimation').textContent");
  await browser.picture('smooth.png');
  told(`60 s of 16 signals at 10 kHz: the first plot was drawn ${drawn.toFixed(1)} times a second over 10 s; the page: ${text}`);
  told(`buckets moved ${frames[0].toFixed(1)} times a second, longest ${frames[1].toFixed(0)} ms`);
  await browser.close();
  await ended(drive);
}

async function captures() {
  const drive = await launch('captures', ...fast);
  const signals = ['measurement.i_a_A', 'measurement.theta_m_rad', 'truth.omega_m_rad_s', 'truth.T_em_Nm', 'estimate.theta_e_rad', 'estimate.omega_m_rad_s', 'command.u_alpha_V', 'reference.omega_m_ref_rad_s'];
  const get = async (path) => fetch(drive.address + path);
  while ((await (await get('api/info')).json()).brief.last_k < 2000) await wait(50);
  await fetch(`${drive.address}api/trigger`, { method: 'POST', body: JSON.stringify({ mode: 'normal', signal: 'measurement.i_a_A', edge: 'rising', level: 0, hysteresis: 0.02, length_ticks: 500, pre_share: 0.5 }) });
  const held = new Map();
  while (held.size < 100)
    for (const c of (await (await get('api/info')).json()).brief.captures) {
      if (held.has(c.id)) continue;
      const answer = await get(`api/samples?signals=${signals}&capture=${c.id}&from=${c.from}&to=${c.to}`);
      held.set(c.id, { ...c, values: new Float64Array(await answer.arrayBuffer()) });
    }
  await ended(drive);
  const log = spawn(twinrate, ['scope', 'runs/captures', '--port', '0'], { stdio: ['ignore', 'pipe', 'inherit'] });
  const address = await new Promise((found) => log.stdout.once('data', (piece) => found(String(piece).match(/http:\S+/)[0])));
  const last = Math.max(...[...held.values()].map((c) => c.to));
  for (let k = -1; k < last;) { await wait(200); k = (await (await fetch(`${address}api/info`)).json()).brief.last_k; }
  await wait(500);
  let whole = 0, ticks = 0;
  for (const c of [...held.values()].slice(0, 100)) {
    const logged = new Float64Array(await (await fetch(`${address}api/samples?signals=${signals}&from=${c.from}&to=${c.to}`)).arrayBuffer());
    const same = logged.length === c.values.length && logged.every((v, i) => v === c.values[i]);
    whole += same && c.missing === 0 && c.to - c.from === 500;
    ticks += c.to - c.from;
  }
  told(`${whole} of 100 captures at 10 kHz hold every one of their ticks (${ticks} in all, ${signals.length} signals) as the log does`);
  log.kill('SIGINT');
}

async function clicks() {
  const drive = await launch('clicks');
  const browser = await Browser.open(drive.address);
  await browser.until('curves', CURVES);
  await browser.click('#take-control');
  await browser.until('control', "!document.querySelector('[data-kind=reset]').disabled");
  // Keys and clicks as those of a person; the page's own clock tells when each came and when its answer was there.
  await browser.evaluate(`void (() => {
    window.asked = []; window.told = []; let begun = 0;
    const note = (e) => { if (e.isTrusted && (e.type === 'click' ? e.target.closest('[data-kind]') : e.key === 'Enter')) begun = e.timeStamp; };
    addEventListener('keydown', note, true); addEventListener('click', note, true);
    new MutationObserver(() => { const text = document.querySelector('#steering-told').textContent; if (begun && text) { asked.push(performance.now() - begun); told.push(text); begun = 0; } }).observe(document.querySelector('#steering-told'), { childList: true, characterData: true, subtree: true });
  })()`);
  const count = Number(process.env.COUNT ?? 1000);
  const answered = async (n) => { while (await browser.evaluate('told.length') < n) await wait(2); };
  const enter = (type) => browser.send('Input.dispatchKeyEvent', { type, key: 'Enter', code: 'Enter', windowsVirtualKeyCode: 13, ...(type === 'keyDown' ? { text: '\r' } : {}) });
  // 900 loads typed into the field, 50 stops and 50 starts by their buttons.
  for (let i = 0; i < count; ++i) {
    if (i % 10 === 9) {
      await browser.click(`[data-kind=${i % 20 === 9 ? 'stop' : 'start'}]`);
    } else {
      await browser.evaluate("document.querySelector('[name=load_Nm]').focus(); document.querySelector('[name=load_Nm]').select()");
      await browser.send('Input.insertText', { text: (0.0001 * (i % 40)).toFixed(4) });
      await enter('keyDown');
      await enter('keyUp');
    }
    await answered(i + 1);
  }
  const [ms, texts] = await browser.evaluate('[asked, told]');
  const at = (list, share) => list.toSorted((a, b) => a - b)[Math.min(list.length - 1, Math.floor(share * list.length))];
  const withTick = texts.filter((text) => /plant from tick \d+ on/.test(text)).length;
  told(`${withTick} of ${count} keys and clicks of the page answered with a tick; ${texts.filter((t) => !/from tick/.test(t)).slice(0, 3)}`);
  for (const [what, is] of [['Enter in the field', (i) => i % 10 !== 9], ['click of start or stop', (i) => i % 10 === 9]]) {
    const list = ms.filter((_, i) => is(i));
    told(`from ${what} to the answer, which comes when all processes have the tick: p50 ${at(list, 0.5).toFixed(1)} ms, p99 ${at(list, 0.99).toFixed(1)} ms, longest ${at(list, 1).toFixed(1)} ms (${list.length})`);
  }
  await browser.close();
  await ended(drive);
  told(drive.text().match(/.*(messages lost|lost).*/g)?.join('\n') ?? '');
  told(spawnSync(requests, ['--log', 'runs/clicks'], { encoding: 'utf8' }).stdout.trim());
  told(spawnSync(twinrate, ['replay', '--lockstep', 'runs/clicks'], { encoding: 'utf8' }).stdout.trim());
}

const parts = { first, smooth, captures, clicks };
for (const name of wanted.length ? wanted : Object.keys(parts)) {
  await parts[name]();
  told(`(${cpus().length} processors, load ${loadavg()[0].toFixed(1)})`);
}
process.exit(0);

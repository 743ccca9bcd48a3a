// Hostile requests to the page of a running drive: what is refused, and what the drive notices.
//
//   node bench/scope_hostile.mjs TWINRATE DIRECTORY
//
// The drive runs in lock-step with the wall clock; its scope listens on every address, so that a token is needed.
import { spawn } from 'node:child_process';
import { mkdirSync, readFileSync, rmSync } from 'node:fs';
import { connect } from 'node:net';

const [twinrate, directory] = process.argv.slice(2);
rmSync(`${directory}/runs`, { recursive: true, force: true });
mkdirSync(directory, { recursive: true });
process.chdir(directory);
const wait = (ms) => new Promise((go) => setTimeout(go, ms));
const started = [];
const start = (...args) => { const child = spawn(twinrate, args, { stdio: ['ignore', 'pipe', 'inherit'] }); started.push(child); return child; };
process.on('exit', () => started.forEach((child) => child.kill('SIGINT')));

const drive = start('launch', 'dilys2021', '--duration', 'inf', '--pace', 'wall', '--run-dir', 'runs/attacked');
drive.stdout.resume();
const scope = start('scope', '--listen', '0.0.0.0', '--port', '0');
const address = await new Promise((found) => scope.stdout.once('data', (text) => found(new URL(String(text).match(/http:\S+/)[0]))));
const token = address.searchParams.get('token'), port = Number(address.port);

// The first line of the answer, or how the connection ended.
function raw(text, { limit_ms = 6000, endless = '' } = {}) {
  return new Promise((found) => {
    const socket = connect(port, '127.0.0.1');
    let sent = 0, answer = '';
    const end = (why) => { socket.destroy(); found({ answer: answer.split('\r\n')[0] || why, sent }); };
    const timer = setTimeout(() => end('open'), limit_ms);
    const pour = () => { while (endless && !socket.destroyed && socket.write(endless)) sent += endless.length; sent += endless.length; };
    socket.on('connect', () => { socket.write(text); if (endless) { pour(); socket.on('drain', pour); } });
    socket.on('data', (bytes) => { answer += bytes; clearTimeout(timer); end('answered'); });
    socket.on('error', () => { clearTimeout(timer); end('closed'); });
    socket.on('close', () => { clearTimeout(timer); end('closed'); });
  });
}
const host = `127.0.0.1:${port}`;
const ask = (line, headers = '', body = '') => raw(`${line} HTTP/1.1\r\nHost: ${host}\r\n${headers}${body ? `Content-Length: ${body.length}\r\n` : ''}\r\n${body}`);
const told = async (what, list) => {
  const seen = new Map();
  for (const one of await Promise.all(list)) seen.set(one.answer, (seen.get(one.answer) ?? 0) + 1);
  console.log(`${what}: ${[...seen].map(([answer, count]) => `${count} x ${answer}`).join(', ')}`);
};

while (!(await (await fetch(`${address.origin}/api/info?token=${token}`)).json()).live.heard) await wait(100);
await wait(1000);
const stop = JSON.stringify({ client: 'x', kind: 'emergency_stop' }), control = JSON.stringify({ client: 'x', take: true });
await told('with the token', [ask(`GET /api/info?token=${token}`)]);
await told('without or with a wrong token', [ask('GET /'), ask('GET /api/info'), ask('GET /api/stream'), ask('POST /api/request', '', stop), ask('POST /api/control', '', control), ask(`GET /?token=${'0'.repeat(32)}`), ask('POST /api/request?token=', '', stop)]);
await told('another Origin, or from another site', [ask(`POST /api/request?token=${token}`, 'Origin: http://evil.example\r\n', stop), ask(`POST /api/control?token=${token}`, 'Origin: null\r\n', control), ask(`POST /api/request?token=${token}`, 'Sec-Fetch-Site: cross-site\r\n', stop)]);
const paths = ['/../../etc/passwd', '/%2e%2e/%2e%2e/etc/passwd', '//etc/passwd', '/..%2f..%2fetc%2fpasswd', '/api/../../etc/passwd', '/trace?id=../../etc/passwd', '/trace?id=-1', '/main.js/../../config.toml', '/api/data?source=run:../../etc&signals=x', `/${'a'.repeat(9000)}`, '/main.js%00.html', '/session.json', '/runs/attacked/log.lcm'];
await told('paths', paths.map((path) => ask(`GET ${path}${path.includes('?') ? '&' : '?'}token=${token}`)));
const begun = Date.now();
const bodies = await Promise.all([
  raw(`POST /api/request?token=${token} HTTP/1.1\r\nHost: ${host}\r\nContent-Length: 1000000000000\r\n\r\n`, { endless: 'x'.repeat(65536) }),
  raw(`POST /api/request?token=${token} HTTP/1.1\r\nHost: ${host}\r\nTransfer-Encoding: chunked\r\n\r\n`, { endless: `8000\r\n${'x'.repeat(32768)}\r\n` }),
  raw(`GET / HTTP/1.1\r\nHost: ${host}\r\n`, { endless: `X-A: ${'a'.repeat(1000)}\r\n` }),
  raw(`POST /api/request?token=${token} HTTP/1.1\r\nHost: ${host}\r\nContent-Length: 100\r\n\r\n{`)]);
console.log(`endless body, endless chunks, endless headers, a body that stays away: ${bodies.map(({ answer, sent }) => `${answer} (${(sent / 1024).toFixed(0)} KiB sent)`).join(', ')}; all over after ${Date.now() - begun} ms`);

// 10,000 connections that say nothing, 2000 open at a time; a page asks meanwhile.
let opened = 0, closed = 0, answers = 0, refused = 0;
const silent = [];
const flood = Date.now();
for (let i = 0; i < 10000; ++i) {
  const socket = connect(port, '127.0.0.1');
  socket.on('connect', () => ++opened).on('error', () => {}).on('close', () => ++closed);
  silent.push(socket);
  if (silent.length > 2000) silent.shift().destroy();
  if (i % 500 === 499) {
    await wait(50);
    await fetch(`${address.origin}/api/info?token=${token}`).then((r) => (r.ok ? ++answers : ++refused), () => ++refused);
  }
}
console.log(`10000 silent connections in ${Date.now() - flood} ms: ${opened} were taken, ${closed} were closed; of 20 requests of a page in between ${answers} were answered, ${refused} were not`);
silent.forEach((socket) => socket.destroy());
const after = Date.now();
while (!await fetch(`${address.origin}/api/info?token=${token}`).then((r) => r.ok, () => false)) await wait(20);
console.log(`the page answers again ${Date.now() - after} ms later`);
const status = readFileSync(`/proc/${scope.pid}/status`, 'utf8');
console.log(`the scope: ${status.match(/VmRSS:\s+(\d+)/)[1] / 1024 | 0} MiB, ${status.match(/Threads:\s+(\d+)/)[1]} threads`);
drive.kill('SIGINT');
const code = await new Promise((gone) => drive.once('exit', gone));
const { summary: _, ...s } = JSON.parse(readFileSync('runs/attacked/summary.json', 'utf8'));
console.log(`the drive: exit code ${code}, locked ${s.locked}, ${s.steps} steps in ${s.wall_s.toFixed(1)} s, lost ${JSON.stringify(s.lost_messages)}, trip ${JSON.stringify(s.trip)}`);
process.exit(0);

// Headless Chromium over its debugging pipe: open a page, click, drag and type as a person does, take pictures.
import { spawn } from 'node:child_process';
import { mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';

export class Browser {
  static async open(url, { width = 1500, height = 900 } = {}) {
    const browser = new Browser();
    browser.directory = mkdtempSync(join(tmpdir(), 'twinrate-browser-'));
    browser.process = spawn('chromium', ['--headless=new', '--no-sandbox', '--disable-gpu', '--disable-dev-shm-usage', '--no-first-run', '--disable-extensions', '--force-color-profile=srgb',
      '--disable-background-networking', '--remote-debugging-pipe', `--user-data-dir=${browser.directory}`, `--window-size=${width},${height}`, 'about:blank'],
    { stdio: ['ignore', 'ignore', 'ignore', 'pipe', 'pipe'] });  // of this session: the scheduler can starve the autogroup of another one
    browser.answers = new Map();
    browser.errors = [];
    browser.number = 0;
    let rest = '';
    browser.process.stdio[4].on('data', (bytes) => {
      const texts = (rest + bytes).split('\0');
      rest = texts.pop();
      texts.forEach((text) => browser.take(JSON.parse(text)));
    });
    browser.process.stdio[3].on('error', () => {});  // it ended: what was asked gets no answer
    try {
      await browser.begin(url, width, height);
    } catch (error) {
      await browser.close();
      throw error;
    }
    return browser;
  }

  async begin(url, width, height) {
    const { targetId } = await this.send('Target.createTarget', { url: 'about:blank' });
    this.session = (await this.send('Target.attachToTarget', { targetId, flatten: true })).sessionId;
    await this.send('Runtime.enable');
    await this.send('Page.enable');
    await this.send('Emulation.setDeviceMetricsOverride', { width, height, deviceScaleFactor: 1, mobile: false });
    await this.send('Page.navigate', { url });
  }

  take(message) {
    if (message.method === 'Runtime.exceptionThrown') {
      const { text, exception } = message.params.exceptionDetails;
      this.errors.push(exception?.description ?? text);
    }
    const waiting = this.answers.get(message.id);
    if (!waiting) return;
    this.answers.delete(message.id);
    if (message.error) waiting.reject(new Error(message.error.message)); else waiting.resolve(message.result);
  }

  // The limits are for a machine that does other things as well: nothing waits for them where the answer comes.
  send(method, params = {}, limit_s = 90) {
    const id = ++this.number;
    this.process.stdio[3].write(`${JSON.stringify({ id, method, params, ...(this.session ? { sessionId: this.session } : {}) })}\0`);
    // A request that a navigation overtakes gets no answer.
    return new Promise((resolve, reject) => {
      const late = setTimeout(() => { this.answers.delete(id); reject(new Error(`${method}: no answer within ${limit_s} s`)); }, 1000 * limit_s);
      const end = (action) => (what) => { clearTimeout(late); action(what); };
      this.answers.set(id, { resolve: end(resolve), reject: end(reject) });
    });
  }

  async evaluate(expression, limit_s) {
    const { result, exceptionDetails } = await this.send('Runtime.evaluate', { expression, returnByValue: true, awaitPromise: true }, limit_s);
    if (exceptionDetails) throw new Error(`${expression}: ${exceptionDetails.exception?.description ?? exceptionDetails.text}`);
    return result.value;
  }

  // Waits until the expression is true; the claim is what the test says if it never is.
  async until(claim, expression, limit_s = 90) {
    const end = Date.now() + 1000 * limit_s;
    while (Date.now() < end) {
      if (await this.evaluate(expression, 5).catch(() => false)) return;
      await new Promise((go) => setTimeout(go, 50));
    }
    throw new Error(`not within ${limit_s} s: ${claim}`);
  }

  mouse(type, x, y, more = {}) {
    return this.send('Input.dispatchMouseEvent', { type, x, y, button: 'left', clickCount: 1, ...more });
  }

  async place(selector, fx = 0.5, fy = 0.5) {
    const box = await this.evaluate(`(() => { const n = document.querySelector(${JSON.stringify(selector)}); n.scrollIntoView({block: 'nearest'}); const b = n.getBoundingClientRect(); return [b.left, b.top, b.width, b.height]; })()`);
    return [box[0] + fx * box[2], box[1] + fy * box[3]];
  }

  // Again where the page moved or replaced the element under the pointer: the click reached something else, or nothing.
  async click(selector, fx, fy) {
    const name = JSON.stringify(selector);
    await this.evaluate("window.wanted ??= (addEventListener('click', (e) => { window.clicked = !!e.target.closest(window.wanted); }, true), 'none')");
    for (let i = 0; i < 50; ++i) {
      await this.evaluate(`window.clicked = false; window.wanted = ${name}; 0`);
      const [x, y] = await this.place(selector, fx, fy);
      if (!await this.evaluate(`!!document.elementFromPoint(${x}, ${y})?.closest(${name})`)) continue;
      await this.mouse('mousePressed', x, y);
      await this.mouse('mouseReleased', x, y);
      if (await this.evaluate('window.clicked')) return;
    }
    throw new Error(`no click reaches ${selector}`);
  }

  async drag([x0, y0], [x1, y1]) {
    await this.mouse('mouseMoved', x0, y0, { button: 'none' });
    await this.mouse('mousePressed', x0, y0);
    for (let i = 1; i <= 6; ++i) await this.mouse('mouseMoved', x0 + (x1 - x0) * i / 6, y0 + (y1 - y0) * i / 6, { buttons: 1 });
    await this.mouse('mouseReleased', x1, y1);
  }

  // Drag and drop, from an element to a place, by the page's own events: the browser's drag by mouse hangs on a busy
  // machine (Input.dispatchDragEvent gets no answer).
  drop(selector, [x1, y1]) {
    return this.evaluate(`(() => {
      const source = document.querySelector(${JSON.stringify(selector)}), target = document.elementFromPoint(${x1}, ${y1}), dataTransfer = new DataTransfer();
      if (!source.closest('[draggable=true]')) throw new Error('nobody can drag this');
      const send = (node, type) => node.dispatchEvent(new DragEvent(type, { bubbles: true, cancelable: true, dataTransfer, clientX: ${x1}, clientY: ${y1} }));
      send(source, 'dragstart');
      send(target, 'dragenter');
      if (send(target, 'dragover')) throw new Error('the place takes no drop');
      send(target, 'drop');
      send(source, 'dragend');
    })()`);
  }

  async type(selector, text) {
    await this.evaluate(`document.querySelector(${JSON.stringify(selector)}).focus(); document.querySelector(${JSON.stringify(selector)}).select?.()`);
    await this.send('Input.insertText', { text });
    await this.evaluate(`document.querySelector(${JSON.stringify(selector)}).dispatchEvent(new Event('change', {bubbles: true}))`);
  }

  async key(key, code = key) {
    for (const type of ['keyDown', 'keyUp']) await this.send('Input.dispatchKeyEvent', { type, key, code, windowsVirtualKeyCode: { Escape: 27, Enter: 13 }[key] ?? key.toUpperCase().charCodeAt(0) });
  }

  async picture(file) {
    const { data } = await this.send('Page.captureScreenshot', { format: file.endsWith('.webp') ? 'webp' : 'png', quality: file.endsWith('.webp') ? 45 : undefined });
    writeFileSync(file, Buffer.from(data, 'base64'));
  }

  // Chromium's children end with it; what one of them still writes may outlive its directory.
  close() {
    return new Promise((gone) => {
      const remove = () => {
        try {
          rmSync(this.directory, { recursive: true, force: true, maxRetries: 20, retryDelay: 50 });
        } catch { /* the system's directory of temporary files */ }
        gone();
      };
      if (this.process.exitCode !== null || this.process.signalCode !== null) return remove();
      this.process.once('exit', remove);
      this.process.kill('SIGKILL');
    });
  }
}

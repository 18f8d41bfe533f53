// The page: loads what it holds while it is shown, and draws when something has changed.
import { lookAlong } from './camera.js';
import { Controls } from './controls.js';
import { enter, offer } from './headset.js';
import { parts, readHeader } from './payload.js';
import { Renderer } from './renderer.js';
import { View } from './view.js';

/** Milliseconds of a frame beyond which frames become smaller while something moves. */
const SLOW_MS = 45;
/** Milliseconds without a change after which the frame is drawn in full. */
const STILL_MS = 160;

const byId = (id) => document.getElementById(id);
/** Shows a status text; damage that the watchdog found stays shown. */
const say = (text) => (byId('status').textContent = document.body.dataset.damage ?? text);

class Page {
  constructor() {
    this.header = readHeader(byId('header'));
    this.canvas = byId('canvas');
    this.view = new View(this.header);
    this.ui = this.view.restore(location.hash).ui;
    document.body.classList.toggle('bare', !this.ui);
    document.body.classList.toggle('elsewhere', location.hash.includes('eye='));
    this.renderer = new Renderer(this.canvas, this.header);
    Object.assign(this, { dirty: true, coarse: 1, movedAt: -Infinity, complete: false, inHeadset: false, lastFrame: 0, runs: false });
    this.controls = new Controls(this.canvas, this.view, () => this.changed());
    this.canvas.addEventListener('webglcontextlost', (event) => {
      event.preventDefault();
      fail(new Error('The graphics driver has dropped this page. Load it again to go on.'));
    });
    addEventListener('resize', () => (this.dirty = true));
    addEventListener('hashchange', () => {
      this.view.restore(location.hash);
      this.dirty = true;
    });
    if (this.ui) this.connect();
  }

  connect() {
    const click = (id, action) => byId(id).addEventListener('click', () => Promise.resolve(action()).catch((error) => say(error.message)));
    click('home', () => {
      this.view.reset();
      this.changed();
    });
    click('link', async () => {
      await navigator.clipboard.writeText(location.href.split('#')[0] + this.view.link());
      say('A link to this view has been copied.');
    });
    click('full', () => (document.fullscreenElement ? document.exitFullscreen() : document.documentElement.requestFullscreen()));
    const showKeys = (open) => {
      byId('keys').hidden = !open;
      byId('help').setAttribute('aria-expanded', String(open));
    };
    click('help', () => showKeys(byId('keys').hidden));
    addEventListener('keydown', ({ key }) => {
      if (key === '?') showKeys(byId('keys').hidden);
      else if (key === 'Escape') showKeys(false);
    });
    for (const input of ['pointerdown', 'wheel', 'keydown']) addEventListener(input, () => (byId('hint').hidden = true), { once: true });
    click('gyroscope', () => this.controls.toggleGyroscope());
    byId('gyroscope').hidden = !('DeviceOrientationEvent' in globalThis && matchMedia('(pointer: coarse)').matches);
    click('headset', async () => {
      this.inHeadset = true;
      await enter(this.renderer, this.view, () => {
        this.inHeadset = false;
        this.dirty = true;
      }).catch((error) => {
        this.inHeadset = false;
        throw error;
      });
    });
    offer(byId('headset'));
  }

  changed() {
    this.dirty = true;
    this.movedAt = performance.now();
  }

  /** Loads all parts; what has come is drawn meanwhile. */
  async load() {
    let drawnAt = performance.now();
    let pause = 400;
    let done = 0;
    const whole = this.header.parts.reduce((sum, part) => sum + part.packed, 0);
    for await (const [part, bytes] of parts(this.header)) {
      await this.renderer.add(part, bytes);
      this.view.place.take(part, bytes);
      done += part.packed;
      byId('progress').value = done / whole;
      // Parts come as the view begins to need them; the first picture waits for those that it must have.
      const isDrawn = document.body.classList.contains('drawn');
      const isTime = part.first || ((part.later || isDrawn) && performance.now() - drawnAt > pause);
      if (this.ui && done < whole && isTime) {
        this.draw(1);
        drawnAt = performance.now();
        // Pictures on the way shall not hold up the whole.
        pause *= 2;
        await new Promise(requestAnimationFrame);
        this.run();
      }
    }
    this.complete = true;
    document.body.dataset.loadedMs = Math.round(performance.now());
    byId('progress').hidden = true;
    say(`${this.header.name} is loaded.`);
    this.dirty = true;
    this.run();
  }

  /** Draws what changes from now on. */
  run() {
    if (this.runs) return;
    this.runs = true;
    requestAnimationFrame((time) => this.frame(time));
  }

  /** Draws a frame, `scale` times as large as the page. */
  draw(scale) {
    const pixels = Math.min(devicePixelRatio, 2) * scale;
    const size = [this.canvas.clientWidth, this.canvas.clientHeight].map((side) => Math.max(Math.round(side * pixels), 1));
    if (this.canvas.width !== size[0] || this.canvas.height !== size[1]) [this.canvas.width, this.canvas.height] = size;
    const { eye, forward, up, fov } = this.view;
    this.renderer.draw(lookAlong(eye, forward, up, fov, size));
    this.dirty = false;
    if (!document.body.classList.contains('drawn')) {
      document.body.classList.add('drawn');
      document.body.dataset.firstPictureMs = Math.round(performance.now());
    }
  }

  frame(time) {
    requestAnimationFrame((next) => this.frame(next));
    const elapsed = Math.min(time - this.lastFrame, 250);
    this.lastFrame = time;
    if (this.inHeadset) return;
    if (this.controls.step(elapsed / 1000)) this.changed();
    const moving = performance.now() - this.movedAt < STILL_MS;
    if (moving && this.dirty && elapsed > SLOW_MS) this.coarse = Math.max(this.coarse * 0.8, 0.3);
    const settles = !moving && this.unsettled;
    if (!this.dirty && !settles) return;
    this.unsettled = moving;
    this.draw(moving ? this.coarse : 1);
    if (!moving) this.settle();
  }

  /** Nothing moves, and the frame is drawn in full. */
  settle() {
    const room = Number.isFinite(this.movedAt) ? this.view.place.words(this.view.eye) : '';
    if (room && room !== this.room) say((this.room = room));
    if (this.ui && Number.isFinite(this.movedAt)) history.replaceState(null, '', this.view.link());
    if (!this.ui && this.complete) this.renderer.gl.finish();
    if (!this.ui && this.complete) document.title = 'ready';
  }
}

/** Says what went wrong; the poster stays. */
function fail(error) {
  document.body.classList.add('failed');
  byId('progress').hidden = true;
  say(error.message);
  byId('status').setAttribute('role', 'alert');
}

document.body.dataset.viewer = 'started';
try {
  if (!('DecompressionStream' in globalThis)) throw new Error('This browser is too old for this page: it has no DecompressionStream.');
  const page = new Page();
  globalThis.headbox = page;
  page.load().catch(fail);
} catch (error) {
  fail(error);
}

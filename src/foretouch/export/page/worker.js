"use strict";
// The session in a worker: leader, follower, robot, material and hand are compiled kernels; the network is below.
// All time is that of a grid of 1 ms: what a timer does decides only when a tick is computed, never what comes of it.

const MS = 1;
const COLUMNS = 10; // of a tick as it is shown: see `tick`
const KEPT = 4096; // ticks that wait to be shown, at most
const LATEST = 200; // ticks that are made up for; what a sleeping machine misses beyond is left out [ms]

let wasm, memory, room, session, trial;

// A generator of 32 bits (mulberry32): the same numbers from the same seed, on every machine.
function generator(seed) {
  let state = seed >>> 0;
  const next = () => {
    state = (state + 0x6d2b79f5) >>> 0;
    let mixed = Math.imul(state ^ (state >>> 15), state | 1);
    mixed = (mixed + Math.imul(mixed ^ (mixed >>> 7), mixed | 61)) ^ mixed;
    return ((mixed ^ (mixed >>> 14)) >>> 0) / 4294967296;
  };
  // A sum of twelve has nearly a normal distribution, and needs no function that differs between machines.
  next.normal = () => { let sum = -6; for (let k = 0; k < 12; k++) sum += next(); return sum; };
  return next;
}

// One direction of the network: bytes that arrive a delay later, or never.
class Way {
  constructor(seed) { this.draw = generator(seed); this.delay = 0; this.loss = 0; this.waiting = []; this.first = 0; this.bytes = 0; }
  push(now, kind, bytes) {
    this.bytes += bytes.length;
    if (this.draw() < this.loss) return;
    this.waiting.push({ due: now + this.delay, kind, bytes });
  }
  set(now, delay, loss) {
    this.loss = loss;
    this.delay = delay;
    for (let k = this.first; k < this.waiting.length; k++) this.waiting[k].due = Math.min(this.waiting[k].due, now + delay);
  }
  pop(now) {
    const { waiting } = this;
    if (this.first < waiting.length && waiting[this.first].due <= now) return waiting[this.first++];
    if (this.first > 1024) { waiting.splice(0, this.first); this.first = 0; }
    return null;
  }
}

class Session {
  constructor(options) {
    Object.assign(this, { options, now: 0, aim: 0, auto: false, delayed: options.delayed, epoch: 0 });
    this.draw = generator(options.seed + 2);
    this.up = new Way(options.seed);
    this.down = new Way(options.seed + 1);
    this.set(options.delay, options.loss);
    wasm.page_start_follower(options.material, 1);
    wasm.page_start_hand();
    this.lead();
  }
  // Another leader, which knows nothing yet, and takes over from the one before.
  lead() { wasm.page_start_leader(++this.epoch); }
  set(delay, loss) { this.up.set(this.now, delay, loss); this.down.set(this.now, delay, loss); }
  // The delayed force takes the model's place as it is. What it did to the energy of the hand, only another leader forgets.
  render(delayed) {
    if (this.delayed && !delayed) this.lead();
    this.delayed = delayed;
  }
  receive(message) { new Uint8Array(memory.buffer, room, message.bytes.length).set(message.bytes); return message.bytes.length; }
  send(way, kind, size) { if (size > 0) way.push(this.now, kind, new Uint8Array(memory.buffer, room, size).slice()); }

  // One tick of 1 ms: what has arrived at the follower, the follower, the robot; the same of hand and leader.
  tick(aim) {
    this.now += MS;
    const { now, draw } = this;
    let message;
    while ((message = this.up.pop(now))) wasm.page_take(this.receive(message), now);
    wasm.page_follow(now);
    this.send(this.down, "model", wasm.page_model(now));
    this.send(this.down, "telemetry", wasm.page_telemetry(now));
    wasm.page_exchange(draw.normal(), draw.normal(), draw.normal());
    while ((message = this.down.pop(now))) {
      if (message.kind === "telemetry") wasm.page_hear(this.receive(message));
      else if (!this.delayed) wasm.page_adopt(this.receive(message)); // the baseline uses no model, whichever comes
    }
    wasm.page_lead(now, aim, this.delayed ? 1 : 0);
    this.send(this.up, "command", wasm.page_command());
    return new Float64Array(memory.buffer, wasm.page_shown(), COLUMNS);
  }
}

// ---- In real time ----

let began = 0, shown = new Float64Array(KEPT * COLUMNS), count = 0, timer = 0, paused = false, made = 0, spent = 0, aimed = 0;

// The script of "press for me": down and up again within 4 s, a little deeper or less deep each time.
function scripted(now) {
  const phase = (now % 4000) / 4000, depth = 0.024 + 0.004 * Math.sin(now / 2900);
  return depth * 0.5 * (1 - Math.cos(2 * Math.PI * Math.min(phase * 1.25, 1)));
}

const FASTEST = 1e-4; // The aim moves at most so far in a tick [m]: no hand jumps

let shift = 0; // of the script, by which the hand is off from the probe [m]
function aimNow() {
  if (!session.auto) return session.aim;
  if (session.now % 4000 === 0) shift = session.row ? session.row[2] - session.row[3] || 0 : 0;
  return scripted(session.now) + shift;
}

function run() {
  const before = performance.now();
  let target = Math.floor(before - began);
  if (target - session.now > LATEST) { began += target - session.now - LATEST; target = session.now + LATEST; }
  const ticks = target - session.now;
  for (let k = 0; k < ticks; k++) {
    aimed += Math.max(-FASTEST, Math.min(FASTEST, aimNow() - aimed));
    session.row = session.tick(aimed);
    if (count < KEPT) shown.set(session.row, COLUMNS * count++);
  }
  made += ticks;
  spent += performance.now() - before;
  timer = setTimeout(run, 1);
}

function pause(on) {
  clearTimeout(timer);
  paused = on;
  if (!on) { began = performance.now() - session.now; run(); }
}

// Another material: all begins anew, with the network as it is.
function restart(material) {
  const { up, delayed, auto, options } = session;
  session = new Session({ ...options, material, delayed, delay: up.delay, loss: up.loss });
  session.auto = auto;
  aimed = count = 0;
  began = performance.now();
}

function frame(buffer) {
  const rows = buffer && buffer.byteLength >= 8 * COLUMNS * count ? new Float64Array(buffer) : new Float64Array(KEPT * COLUMNS);
  rows.set(shown.subarray(0, COLUMNS * count));
  const said = {
    from: "frame", rows, count, made, spent, now: session.now, up: session.up.bytes, down: session.down.bytes,
    has_model: wasm.page_has_model() !== 0, engaged: wasm.page_engaged() !== 0,
    status: wasm.page_status(),
  };
  count = 0;
  postMessage(said, [rows.buffer]);
}

// ---- A course without a clock, for tests and for measuring: it takes the place of the session ----

function course(request) {
  const own = (session = new Session(request)), rows = new Float64Array(request.aims.length * COLUMNS);
  const before = performance.now();
  request.aims.forEach((aim, k) => rows.set(own.tick(aim), k * COLUMNS));
  const elapsed = performance.now() - before;
  postMessage({ from: "course", rows, elapsed, up: own.up.bytes, down: own.down.bytes }, [rows.buffer]);
}

// ---- A recording ----

const AT_ONCE = 25; // Time after which a long recording lets other messages through [ms]

function startTrial(request) {
  wasm.page_expect(request.delay);
  trial = { ...request, index: 0, learnt: 0, predicted: new Float64Array(request.time.length) };
  goOn(trial);
}

function goOn(mine) {
  if (mine !== trial) return; // a newer one has begun
  const { time, position, force, delay, predicted } = mine, until = performance.now() + AT_ONCE;
  for (; mine.index < time.length; mine.index++) {
    const now = time[mine.index];
    for (; mine.learnt < time.length && time[mine.learnt] + delay <= now + 1e-7; mine.learnt++)
      wasm.page_learn(time[mine.learnt], position[mine.learnt], force[mine.learnt]);
    predicted[mine.index] = wasm.page_foretell(now, position[mine.index]);
    if ((mine.index & 63) === 63 && performance.now() > until) {
      mine.index++;
      postMessage({ from: "progress", id: mine.id, done: mine.index / time.length });
      setTimeout(() => goOn(mine), 0);
      return;
    }
  }
  postMessage({ from: "trial", id: mine.id, predicted });
}

// ---- What the page asks for ----

const ASKED = {
  begin(request) {
    const instance = new WebAssembly.Instance(new WebAssembly.Module(request.wasm), {});
    wasm = instance.exports;
    memory = wasm.memory;
    room = wasm.page_room();
    session = new Session(request.options);
    postMessage({ from: "ready" });
    if (request.options.clock) pause(false);
  },
  aim(request) { session.aim = request.aim; if (request.ask) frame(request.buffer); },
  network(request) { session.set(request.delay, request.loss); },
  material(request) { restart(request.material); },
  delayed(request) { session.render(request.delayed); },
  auto(request) { session.auto = request.auto; shift = session.row ? session.row[2] - session.row[3] || 0 : 0; },
  pause(request) { if (request.pause !== paused) pause(request.pause); },
  course(request) { course(request); },
  trial(request) { startTrial(request); },
};
onmessage = (event) => ASKED[event.data.to](event.data);

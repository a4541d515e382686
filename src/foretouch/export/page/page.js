// The page around the worker that computes: what is dragged, shown, heard and felt, and the second tab.

const $ = (id) => document.getElementById(id);
const COLUMNS = 10, [TIME, AIM, HAND, PROXY, FELT, PREDICTED, ARRIVED, LATE, ROBOT, TRUE] = Array(COLUMNS).keys();
const WINDOW = 5000; // Time that the plot shows [ms]
const still = matchMedia("(prefers-reduced-motion: reduce)");
const dark = matchMedia("(prefers-color-scheme: dark)");
const asked = new URLSearchParams(location.search);

function fail(text) { $("trouble").hidden = false; $("trouble").textContent = text; }

// ---- The worker ----

const bytesOf = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));

let worker = null;
const heard = {}; // what is done with each kind of answer
function startWorker() {
  // A page that is opened from a file may fetch nothing, so all that the worker needs is in the page.
  worker = new Worker(URL.createObjectURL(new Blob([CONTENT.worker], { type: "text/javascript" })));
  worker.onmessage = (event) => heard[event.data.from]?.(event.data);
  worker.onerror = (event) => fail(`The computing has stopped: ${event.message}`);
  const options = {
    seed: 1, delay: Number($("delay").value), loss: Number($("loss").value) / 100, material: Number($("material").value),
    delayed: false, clock: asked.get("clock") !== "off",
  };
  worker.postMessage({ to: "begin", wasm: bytesOf(CONTENT.wasm).buffer, options });
}
const tell = (to, content) => worker.postMessage({ to, ...content });

// ---- What is kept of the session to be shown ----

const ring = new Float64Array(WINDOW * COLUMNS);
let latest = new Float64Array(COLUMNS), state = { has_model: false, surface: NaN, engaged: false }, total = 0;
let waits = false, spare = null, rate = { at: 0, up: 0, down: 0, made: 0, now: 0 };

heard.ready = () => requestAnimationFrame(draw);
heard.frame = (message) => {
  waits = false;
  const { rows, count } = message;
  for (let k = 0; k < count; k++) {
    const row = rows.subarray(k * COLUMNS, (k + 1) * COLUMNS);
    ring.set(row, (total++ % WINDOW) * COLUMNS);
    latest = row.slice();
  }
  spare = rows.buffer;
  state = message;
};

// ---- The handle ----

let aim = 0, drag = null; // where the hand wants to be [mm]
const LEAST = -5, MOST = 40, SCALE = 4, SURFACE = 10, AT_SURFACE = 130, ABOVE = 60; // mm; pixels per mm and of the picture
const y = (mm) => AT_SURFACE + (mm - SURFACE) * SCALE;

// What the probe is off from the hand [mm]: where a surface turns up under way, the probe waits there, and the hand goes on.
const offset = () => (Number.isFinite(latest[PROXY]) ? 1e3 * (latest[PROXY] - latest[HAND]) : 0);

// All that is shown of the aim is where the probe would be.
function showAim() {
  const shown = (aim + offset()).toFixed(1);
  $("handle").value = shown;
  say("handle-says", `${shown} mm`);
  if ($("handle").getAttribute("aria-valuetext") !== `${shown} millimetres down`) $("handle").setAttribute("aria-valuetext", `${shown} millimetres down`);
}

function setAim(mm) {
  aim = Math.min(MOST, Math.max(LEAST, mm + offset())) - offset();
  if (isOn("auto")) toggle("auto", false);
  showAim();
}

function bindHandle() {
  const scene = $("scene");
  $("handle").addEventListener("input", () => setAim(Number($("handle").value) - offset()));
  $("handle").addEventListener("keydown", (event) => {
    const step = { ArrowDown: 0.5, ArrowRight: 0.5, ArrowUp: -0.5, ArrowLeft: -0.5, PageDown: 3, PageUp: -3 }[event.key];
    if (step === undefined && event.key !== "Home") return;
    event.preventDefault(); // down is deeper, as in the picture
    setAim(step === undefined ? -offset() : aim + step);
  });
  scene.addEventListener("pointerdown", (event) => {
    drag = { y: event.clientY, aim };
    scene.setPointerCapture(event.pointerId);
    scene.classList.add("held");
  });
  scene.addEventListener("pointermove", (event) => {
    if (!drag) return;
    const pixels = scene.getScreenCTM().d;
    setAim(drag.aim + (event.clientY - drag.y) / (SCALE * pixels));
  });
  for (const end of ["pointerup", "pointercancel"]) scene.addEventListener(end, () => { drag = null; scene.classList.remove("held"); });
}

// ---- Drawing ----

const RADIUS = 6; // of the tip [mm]
function pressedLine(depth, close) {
  let path = "";
  for (let x = -160; x <= 160; x += 4) {
    const from = Math.abs(x) / SCALE;
    let sunk = 0;
    if (depth > 0) {
      sunk = depth / (1 + (from / (1.3 * RADIUS)) ** 2);
      if (from < RADIUS) sunk = Math.max(sunk, depth - RADIUS + Math.sqrt(RADIUS * RADIUS - from * from));
    }
    path += `${path ? "L" : "M"}${x},${(AT_SURFACE + sunk * SCALE).toFixed(1)}`;
  }
  return close ? `${path}L160,256L-160,256Z` : path;
}

function arrow(x, force) {
  const top = 126 - Math.min(Math.abs(force) * 10, 100), neck = Math.min(top + 13, 126);
  return top > 125 ? "" : `M${x - 5},126 V${neck} H${x - 11} L${x},${top} L${x + 11},${neck} H${x + 5} V126 Z`;
}

// A line of the material that lies this deep [mm] when nothing presses it.
function grain(depth, sunk) {
  let path = "";
  for (let x = -160; x <= 160; x += 8) {
    const wide = 1.3 * RADIUS + 0.6 * depth, down = sunk > 0 ? (sunk * Math.exp(-depth / 14)) / (1 + (Math.abs(x) / SCALE / wide) ** 2) : 0;
    path += `${path ? "L" : "M"}${x},${(AT_SURFACE + (depth + down) * SCALE).toFixed(1)}`;
  }
  return path;
}

function drawScene() {
  const at = (name, mm) => $(name).setAttribute("transform", `translate(0,${y(1e3 * mm).toFixed(1)})`);
  const proxy = Number.isFinite(latest[PROXY]) ? latest[PROXY] : 0, late = Number.isFinite(latest[LATE]) ? latest[LATE] : 0;
  $("grain").setAttribute("d", [7, 14, 21, 28].map((depth) => grain(depth, 1e3 * proxy - SURFACE)).join(""));
  $("block").setAttribute("d", pressedLine(1e3 * proxy - SURFACE, true));
  $("now-surface").setAttribute("d", pressedLine(1e3 * proxy - SURFACE));
  $("late-surface").setAttribute("d", pressedLine(1e3 * late - SURFACE));
  at("now-probe", proxy);
  at("late-probe", late);
  const grip = y(1e3 * proxy) - ABOVE, hand = grip + (latest[AIM] - latest[HAND]) * 1e3 * SCALE;
  $("grip").setAttribute("transform", `translate(0,${grip.toFixed(1)})`);
  $("aim").setAttribute("cy", hand.toFixed(1));
  $("spring").setAttribute("y1", grip.toFixed(1));
  $("spring").setAttribute("y2", hand.toFixed(1));
  for (const [name, what, x, force] of [["now", "felt", -105, latest[FELT]], ["late", "arriving", 105, latest[ARRIVED]]]) {
    $(`${name}-arrow`).setAttribute("d", arrow(x, force));
    $(`${name}-force`).textContent = `${what} ${force.toFixed(1)} N`;
    $(`${name}-force`).setAttribute("y", 118 - Math.min(Math.abs(force) * 10, 100));
  }
}

let colours = {};
function readColours() {
  const style = getComputedStyle(document.documentElement);
  for (const name of ["now", "late", "true", "line", "quiet", "card"]) colours[name] = style.getPropertyValue(`--${name}`).trim();
}
dark.addEventListener("change", () => { readColours(); drawTrial(); });

// Multiples of a step between two numbers, ten at most, for of numbers beyond all measure the next one is the same.
function ticks(low, high, step) {
  const first = Math.ceil(low / step);
  return Array.from({ length: 10 }, (_, k) => (first + k) * step).filter((one) => one <= high + 1e-9);
}

// A canvas in pixels of the screen, with a frame of axes; returns how values are placed in it.
function axes(canvas, x0, x1, low, high, unit) {
  const ratio = devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const pen = canvas.getContext("2d"), left = 34, bottom = 20, inner = width - left - 6, tall = height - bottom - 8;
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  const px = (x) => left + ((x - x0) / (x1 - x0)) * inner, py = (f) => 8 + ((high - f) / (high - low)) * tall;
  pen.font = "12px system-ui, sans-serif";
  pen.fillStyle = colours.quiet;
  pen.strokeStyle = colours.line;
  pen.lineWidth = 1;
  pen.setLineDash([]);
  const step = [0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100].find((one) => (high - low) / one <= 6) ?? (high - low) / 5;
  pen.textAlign = "right";
  for (const f of ticks(low, high, step)) {
    pen.beginPath(); pen.moveTo(left, py(f)); pen.lineTo(width - 6, py(f)); pen.stroke();
    pen.fillText(`${Number(f.toFixed(2))}`, left - 5, py(f) + 4);
  }
  pen.textAlign = "left";
  pen.fillText("N", 2, 16);
  const wide = (x1 - x0) / 5, even = [0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 60, 120].find((one) => one >= wide) ?? wide;
  pen.textAlign = "center";
  for (const x of ticks(x0, x1, even))
    pen.fillText(`${Number(x.toFixed(2))}${unit}`, Math.min(px(x), width - 16), height - 5);
  return { pen, px, py };
}

function curve({ pen, px, py }, count, at, value, colour, dash, width) {
  pen.strokeStyle = colour;
  pen.lineWidth = width;
  pen.setLineDash(dash);
  pen.lineJoin = "round";
  pen.beginPath();
  let down = false;
  for (let k = 0; k < count; k++) {
    const force = value(k);
    if (!Number.isFinite(force)) { down = false; continue; }
    if (down) pen.lineTo(px(at(k)), py(force)); else pen.moveTo(px(at(k)), py(force));
    down = true;
  }
  pen.stroke();
}

let ceiling = 4;
function drawPlot() {
  const count = Math.min(total, WINDOW), step = 8, shown = Math.floor(count / step);
  const row = (k) => ((total - 1 - (shown - 1 - k) * step + WINDOW) % WINDOW) * COLUMNS;
  let highest = 2;
  for (let k = 0; k < shown; k++) highest = Math.max(highest, ring[row(k) + FELT], ring[row(k) + ARRIVED], ring[row(k) + TRUE]);
  ceiling = Math.max(highest * 1.1, 0.98 * ceiling);
  const placed = axes($("plot"), -WINDOW / 1000, 0, -0.05 * ceiling, ceiling, " s");
  const at = (k) => -((shown - 1 - k) * step) / 1000, value = (column) => (k) => ring[row(k) + column];
  curve(placed, shown, at, value(TRUE), colours.true, [2, 3], 2);
  curve(placed, shown, at, value(ARRIVED), colours.late, [7, 4], 2);
  curve(placed, shown, at, value(FELT), colours.now, [], 2.5);
}

// ---- What is said ----

const STATES = CONTENT.statuses;
function swing() {
  const count = Math.min(total, 1500);
  let low = Infinity, high = -Infinity;
  for (let k = 0; k < count; k += 5) {
    const hand = ring[((total - 1 - k + WINDOW) % WINDOW) * COLUMNS + HAND];
    low = Math.min(low, hand);
    high = Math.max(high, hand);
  }
  return count ? 1e3 * (high - low) : 0;
}

const say = (id, text) => { if ($(id).textContent !== text) $(id).textContent = text; };
let told = 0, summed = 0; // when the traffic was said, and what is going on
function report(now) {
  say("now-number", latest[FELT].toFixed(1));
  say("late-number", latest[ARRIVED].toFixed(1));
  say("true-number", latest[TRUE].toFixed(1));
  if (now - summed >= 200) { summed = now; summarise(); } // soon enough to agree with the numbers
  if (now - told >= 1000) { told = now; sayTraffic(now); }
}

function sayTraffic(now) {
  const passed = (state.now - rate.now) / 1000;
  if (passed > 0) {
    const kilo = (bytes, before) => ((bytes - before) / passed / 1000).toFixed(0);
    say("traffic", `${kilo(state.up, rate.up)} kB/s there, ${kilo(state.down, rate.down)} kB/s back, ` +
      `${Math.round((1000 * (state.made - rate.made)) / (now - rate.at))} ticks a second`);
  }
  rate = { at: now, up: state.up, down: state.down, made: state.made, now: state.now };
  const quiet = !drag && !isOn("auto"), moved = swing(), held = rendersDelayed();
  const swings = `Nobody moves the aim: the handle swings by ${moved.toFixed(1)} mm.`;
  say("delayed-says", quiet && (depthNow() > 0.5 || (held && moved > 1)) ? `${swings}${held ? "" : " Now switch."}` : "Hold the handle still in the material, and switch.");
}

const depthNow = () => 1e3 * latest[PROXY] - SURFACE;
const rendersDelayed = () => $("delayed").getAttribute("aria-checked") === "true";
function summarise() {
  const place = !state.engaged ? "The handle is being coupled to the robot." : depthNow() > 0 ? "You press into the material." : "You are in free air.";
  const known = rendersDelayed() ? "The delayed force is rendered." : state.has_model ? "The material is known: its force is computed here." : "Nothing is known of the material yet.";
  const trouble = state.status in STATES ? ` The robot: ${STATES[state.status]}.` : "";
  say("summary", `${place} ${known}${trouble}`); // read aloud where it changes: the numbers, which always do, stand above
}

// ---- Sound and gamepad ----

let audio = null;
function makeAudio() {
  const context = new AudioContext();
  const voice = (pan, base) => {
    const tone = new OscillatorNode(context, { type: "triangle", frequency: base }), gain = new GainNode(context, { gain: 0 });
    tone.connect(gain).connect(new StereoPannerNode(context, { pan })).connect(context.destination);
    tone.start();
    return (force) => {
      gain.gain.setTargetAtTime(Math.min(Math.max(force, 0) / 20, 0.3), context.currentTime, 0.015);
      tone.frequency.setTargetAtTime(base * (1 + Math.max(force, 0) / 8), context.currentTime, 0.015);
    };
  };
  return { context, now: voice(-1, 196), late: voice(1, 247) };
}
const isOn = (id) => $(id).getAttribute("aria-pressed") === "true";
const moves = () => !$("press").hidden && !isOn("pause"); // else a note or a rumble would stay

const gamepad = () => Array.from(navigator.getGamepads?.() ?? []).find((one) => one?.connected);
const STICK = 0.024; // Speed of the handle with the stick all the way down [mm/ms]
let rumbled = 0, looked = 0;
function useGamepad(now) {
  const passed = Math.min(now - looked, 100); // after a pause of the page the handle does not jump
  looked = now;
  if (!isOn("gamepad")) return;
  const pad = gamepad();
  sayAlso();
  if (!pad || !moves()) return;
  const stick = pad.axes[1] ?? 0, actuator = pad.vibrationActuator;
  if (Math.abs(stick) > 0.15) setAim(aim + stick * STICK * passed);
  if (!actuator || now - rumbled < 80) return;
  rumbled = now;
  const strength = Math.min(Math.max(latest[FELT], 0) / 8, 1);
  actuator.playEffect("dual-rumble", { duration: 120, strongMagnitude: strength, weakMagnitude: strength / 2 }).catch(() => {});
}

// What a gamepad does, or why it does nothing: browsers show a page none before one of its buttons is pressed.
function padSays(pad) {
  if (!pad) return "No gamepad is seen yet: press a button on it.";
  return `Its left stick moves the handle; ${pad.vibrationActuator ? "it rumbles as the felt force does" : "it cannot rumble here"}.`;
}

function sayAlso() {
  const ears = isOn("sound") ? ["Left ear: the force felt now. Right ear: the force that arrives."] : [];
  say("also-says", [...ears, ...(isOn("gamepad") ? [padSays(gamepad())] : [])].join(" "));
}

// ---- A frame ----

let frames = 0, drawn = 0;
function draw(now) {
  requestAnimationFrame(draw);
  frames++;
  if (!waits) {
    waits = true;
    const buffer = spare;
    spare = null;
    worker.postMessage({ to: "aim", aim: 1e-3 * aim, ask: true, buffer }, buffer ? [buffer] : []);
  }
  useGamepad(now);
  if (isOn("sound") && audio) {
    audio.now(moves() ? latest[FELT] : 0);
    audio.late(moves() ? latest[ARRIVED] : 0);
  }
  if ($("press").hidden || (still.matches && now - drawn < 100)) return;
  drawn = now;
  if (isOn("auto")) aim = 1e3 * latest[AIM];
  showAim();
  drawScene();
  drawPlot();
  report(now);
}

// ---- Controls ----

function toggle(id, on) {
  $(id).setAttribute($(id).getAttribute("role") === "switch" ? "aria-checked" : "aria-pressed", String(on));
  SWITCHED[id](on);
}
const SWITCHED = {
  auto: (auto) => tell("auto", { auto, aim: 1e-3 * aim }),
  delayed: (delayed) => { tell("delayed", { delayed }); nudge(); },
  pause: (pause) => tell("pause", { pause }),
  sound: (on) => {
    audio ??= makeAudio();
    if (on) audio.context.resume(); else audio.context.suspend();
    sayAlso();
  },
  gamepad: sayAlso,
};

// The hand draws back a little and presses again: what calms down, and what goes on swinging?
const NUDGE = 3; // [mm]
let nudging = false; // one at a time, so that the hand is back where it was after many clicks
function nudge() {
  if (nudging || isOn("auto")) return;
  const before = aim;
  aim -= NUDGE;
  nudging = true;
  setTimeout(() => {
    nudging = false;
    if (aim === before - NUDGE) aim = before;
  }, 300);
}

function bindControls() {
  $("nudge").addEventListener("click", nudge);
  for (const id of Object.keys(SWITCHED)) {
    const name = $(id).getAttribute("role") === "switch" ? "aria-checked" : "aria-pressed";
    $(id).addEventListener("click", () => toggle(id, $(id).getAttribute(name) !== "true"));
  }
  const network = () => {
    const delay = Number($("delay").value), loss = Number($("loss").value);
    say("delay-says", `${delay} ms`);
    say("loss-says", `${loss} %`);
    if (worker) tell("network", { delay, loss: loss / 100 });
  };
  $("delay").addEventListener("input", network);
  $("loss").addEventListener("input", network);
  network();
  CONTENT.materials.forEach(({ name }, k) => $("material").add(new Option(name, k)));
  const material = () => say("material-says", CONTENT.materials[$("material").value].about);
  material();
  $("material").addEventListener("change", () => {
    material();
    total = 0;
    latest = new Float64Array(COLUMNS);
    if (!isOn("auto")) setAim(0);
    tell("material", { material: Number($("material").value) });
  });
  setAim(0);
}

function bindTabs() {
  const tabs = ["press", "recording"];
  const choose = (name) => {
    for (const one of tabs) {
      $(`tab-${one}`).setAttribute("aria-selected", String(one === name));
      $(`tab-${one}`).tabIndex = one === name ? 0 : -1;
      $(one).hidden = one !== name;
    }
    tell("pause", { pause: name !== "press" || isOn("pause") });
    drawTrial();
  };
  tabs.forEach((name, k) => {
    $(`tab-${name}`).addEventListener("click", () => choose(name));
    $(`tab-${name}`).addEventListener("keydown", (event) => {
      if (!["ArrowLeft", "ArrowRight"].includes(event.key)) return;
      const other = tabs[1 - k];
      choose(other);
      $(`tab-${other}`).focus();
    });
  });
}

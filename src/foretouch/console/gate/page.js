// What the console adds to the viewer's page. It runs before the viewer, and needs nobody's answer.

// Where the processor draws, it draws for its own machine's loops too: cheaper, and no more often than the console asks.
(() => {
  const MOST_IN_SOFTWARE = 10; // pictures a second
  const getContext = HTMLCanvasElement.prototype.getContext;
  const isSoftware = () => {
    const canvas = document.createElement("canvas");
    const gl = getContext.call(canvas, "webgl2") || getContext.call(canvas, "webgl");
    const names = gl && gl.getExtension("WEBGL_debug_renderer_info");
    const name = names ? gl.getParameter(names.UNMASKED_RENDERER_WEBGL) : "";
    gl?.getExtension("WEBGL_lose_context")?.loseContext();
    return /swiftshader|llvmpipe|softpipe|software/i.test(name);
  };
  let software = null;
  HTMLCanvasElement.prototype.getContext = function (kind, options) {
    software ??= isSoftware();
    if (!software) return getContext.call(this, kind, options);
    // Lines are drawn by the processor itself three times as fast as through a graphics card that it plays.
    const cheaper = kind === "2d" ? { willReadFrequently: true } : { antialias: false };
    return getContext.call(this, kind, { ...options, ...cheaper });
  };

  const nextFrame = window.requestAnimationFrame.bind(window);
  let waiting = new Map(), number = 0, asked = false, drawn = -Infinity;
  const period = () => {
    const said = document.querySelector("[FRAMES_ATTRIBUTE]")?.getAttribute("FRAMES_ATTRIBUTE");
    return 1000 / Math.min(Number(said) || 30, software ? MOST_IN_SOFTWARE : 60);
  };
  const draw = (now) => {
    asked = false;
    drawn = performance.now();
    const these = waiting;
    waiting = new Map();
    for (const callback of these.values()) {
      try {
        callback(now);
      } catch (error) {
        reportError(error);
      }
    }
    if (waiting.size) ask();
  };
  const ask = () => {
    if (asked) return;
    asked = true;
    const wait = drawn + period() - performance.now();
    if (wait > 4) setTimeout(() => nextFrame(draw), wait);
    else nextFrame(draw);
  };
  window.requestAnimationFrame = (callback) => {
    waiting.set(++number, callback);
    ask();
    return number;
  };
  window.cancelAnimationFrame = (handle) => waiting.delete(handle);
})();

// A curve has a gap where it is no number: a canvas would join over it.
(() => {
  const lineTo = Path2D.prototype.lineTo;
  const gap = new WeakSet();
  Path2D.prototype.lineTo = function (x, y) {
    if (!Number.isFinite(y)) gap.add(this);
    else if (gap.delete(this)) this.moveTo(x, y);
    else lineTo.call(this, x, y);
  };
})();

// The keys of the emergency stop come first, wherever the focus is: tabs and lists keep keys to themselves.
(() => {
  const keys = ["Escape", "Space"];
  const typing = (box) => box.matches?.("textarea, [contenteditable=true], input[type=text]") && // where a space is text
    !box.matches("[readonly], [inputmode], [role=combobox], [aria-haspopup]");
  const isStop = (event) => keys.includes(event.code) && !event.ctrlKey && !event.altKey && !event.metaKey &&
    (event.code === "Escape" || !typing(event.target));
  const heard = (event) => {
    if (!isStop(event)) return;
    if (event.type === "keydown" && !event.repeat) document.querySelector("STOP_BUTTON")?.click();
    if (event.code === "Escape") return; // it closes lists, too
    event.preventDefault();
    event.stopImmediatePropagation();
  };
  window.addEventListener("keydown", heard, true);
  window.addEventListener("keyup", heard, true); // with this a space presses the button that has the focus
})();

// A list that was chosen from, and a box that was clicked, keep no keys to themselves: the next are the session's.
window.addEventListener("click", (event) => {
  const byPointer = event.detail > 0; // who goes by the keyboard goes on from the box
  if (event.target.closest?.(byPointer ? "[role=option], .mantine-Checkbox-root" : "[role=option]"))
    setTimeout(() => document.activeElement?.blur());
}, true);

// What is typed into the box of a slider is within its range, or goes nowhere, and the box says so.
(() => {
  const note = document.createElement("div");
  note.id = "foretouch-range";
  note.setAttribute("role", "alert");
  note.style.cssText =
    "display:none;position:fixed;z-index:90000;pointer-events:none;padding:3px 8px;background:#fff;color:#000;" +
    "border:2px solid URGENT_COLOUR;border-radius:6px;font:13px/1.3 sans-serif";
  document.documentElement.append(note);
  const READABLE = 5000; // the range stays for so long after the box was left [ms]
  let wrong = null, fading = 0;
  const sliderOf = (box) => box.tagName === "INPUT" && box.closest(".mantine-InputWrapper-root, .mantine-NumberInput-root")
    ?.parentElement?.querySelector("[role=slider]");
  const text = (slider, side) => String(Number(Number(slider.getAttribute(`aria-value${side}`)).toFixed(6)));
  const heard = (event) => {
    const box = event.target, slider = sliderOf(box);
    if (!slider) return;
    const [least, most] = [text(slider, "min"), text(slider, "max")];
    const typed = box.value.trim();
    const right = typed !== "" && Number(typed) >= Number(least) && Number(typed) <= Number(most);
    box.setAttribute("aria-invalid", String(!right));
    clearTimeout(fading);
    note.style.display = right ? "none" : "block";
    wrong = right ? null : box;
    if (right) return;
    event.stopImmediatePropagation(); // nobody hears of it, nor does the viewer, which would put the end of the range
    const place = box.getBoundingClientRect();
    const label = document.querySelector(`label[for="${slider.closest("[id]")?.id}"]`)?.textContent;
    note.textContent = `Not set. ${label || "Allowed"}: ${least} to ${most}`;
    note.style.top = `${place.bottom + 3}px`;
    note.style.right = `${Math.max(document.documentElement.clientWidth - place.right, 4)}px`;
  };
  const left = (event) => {
    if (event.target !== wrong) return;
    const slider = sliderOf(wrong);
    if (slider) wrong.value = text(slider, "now"); // what is set
    wrong.removeAttribute("aria-invalid");
    wrong = null;
    fading = setTimeout(() => (note.style.display = "none"), READABLE);
  };
  window.addEventListener("input", heard, true);
  window.addEventListener("change", heard, true);
  window.addEventListener("focusout", left, true);
})();

// Says that nothing comes from the console any more, or that the session has ended.
(() => {
  const LONGEST = 600; // without a beat [ms]; ten beats come in a second, and a second is what is promised
  const LOOK = 50; // between two looks at least [ms]
  const LONGEST_LOOK = 250; // [ms]; what comes is shown when a frame is drawn: slow frames are no silence of the console
  const TOLD_AGAIN = 1000; // [ms]
  const KEY = matchMedia("WITH_KEYBOARD").matches ? " (Space)" : "";
  let beat = "", silence = 0, looked = performance.now(), since = looked, told = -Infinity, ended = "";
  const box = document.createElement("div");
  box.id = "foretouch-lost";
  box.setAttribute("role", "alert");
  box.style.cssText =
    "display:none;position:fixed;left:12px;bottom:12px;z-index:100000;box-sizing:border-box;pointer-events:none;" +
    "width:min(560px, calc(100vw - 24px));min-height:76px;padding:10px 14px;background:#000;color:#fff;" +
    "border:4px solid URGENT_COLOUR;border-radius:10px;font:16px/1.35 sans-serif";
  const style = document.createElement("style");
  style.textContent =
    "html.foretouch-lost :is(STOP_BUTTON, .foretouch-alerts)" +
    "{opacity:0 !important}" + // nobody takes it for one that works; it is still pressed, should the console come back
    "html.foretouch-lost::after{content:'';position:fixed;inset:0;z-index:99999;pointer-events:none;" +
    "background:rgba(255,255,255,0.6)}";
  const head = document.createElement("b");
  head.style.cssText = "display:block;font-size:19px;color:#ffb27a";
  const text = document.createElement("span");
  box.append(head, text);
  const stopWarning = () => document.querySelector("STOP_BUTTON") === null ? "" : // recordings alone: no robot
    `What is pressed here may not arrive, nor may the emergency stop${KEY}: stop the robot at its own machine, or with ` +
    "\u201cforetouch stop\u201d. ";
  const look = () => {
    requestAnimationFrame(look);
    const now = performance.now();
    if (now - looked < LOOK) return;
    const waited = Math.min(now - looked, LONGEST_LOOK);
    looked = now;
    const found = document.querySelector("[BEAT_ATTRIBUTE]");
    const next = found ? found.getAttribute("BEAT_ATTRIBUTE") : beat;
    ended = found?.getAttribute("ENDED_ATTRIBUTE") || "";
    if ((next !== beat && !ended) || document.hidden) {
      beat = next;
      silence = 0;
      since = now;
    } else {
      silence += waited;
    }
    const lost = silence > LONGEST || ended !== "";
    document.documentElement.classList.toggle("foretouch-lost", lost);
    box.style.display = lost ? "block" : "none";
    if (!lost) {
      text.textContent = "";
      told = -Infinity;
    }
    if (lost && now - told > TOLD_AGAIN) {
      told = now;
      const seconds = Math.round((now - since) / 1000);
      head.textContent = ended ? "ENDED_TEXT" : "\u26a0 LOST_TEXT";
      text.textContent =
        ended ||
        (beat === ""
          ? "It is still loading, or the console refuses it. No emergency stop from here yet."
          : `Nothing has come from it for ${Math.max(seconds, 1)} s. ${stopWarning()}` +
            "A console that was started again has a new address, in its terminal.");
    }
  };
  document.documentElement.append(style, box);
  look();
})();

// Says that nothing comes from the console any more. It runs in the page and needs nobody's answer for it.
(() => {
  const LONGEST = 600; // without a beat [ms]; ten beats come in a second, and a second is what is promised
  const LOOK = 50; // between two looks at least [ms]
  const LONGEST_LOOK = 250; // [ms]; what comes is shown when a frame is drawn: slow frames are no silence of the console
  const TOLD_AGAIN = 1000; // [ms]
  let beat = "", silence = 0, looked = performance.now(), since = looked, told = -Infinity;
  const box = document.createElement("div");
  box.id = "foretouch-lost";
  box.setAttribute("role", "alert");
  box.style.cssText =
    "display:none;position:fixed;left:12px;bottom:12px;z-index:100000;box-sizing:border-box;pointer-events:none;" +
    "width:min(560px, calc(100vw - 24px));min-height:76px;padding:10px 14px;background:#000;color:#fff;" +
    "border:4px solid #d55e00;border-radius:10px;font:16px/1.35 sans-serif";
  const style = document.createElement("style");
  style.textContent =
    "html.foretouch-lost :is(div:has(> .foretouch-alarm) + div > button, .foretouch-alerts)" +
    "{opacity:0 !important}" + // nobody takes it for one that works; it is still pressed, should the console come back
    "html.foretouch-lost::after{content:'';position:fixed;inset:0;z-index:99999;pointer-events:none;" +
    "background:rgba(255,255,255,0.6)}";
  const head = document.createElement("b");
  head.style.cssText = "display:block;font-size:19px;color:#ffb27a";
  head.textContent = "\u26a0 LOST_TEXT";
  const text = document.createElement("span");
  box.append(head, text);
  const look = () => {
    requestAnimationFrame(look);
    const now = performance.now();
    if (now - looked < LOOK) return;
    const waited = Math.min(now - looked, LONGEST_LOOK);
    looked = now;
    const found = document.querySelector("[BEAT_ATTRIBUTE]");
    const next = found ? found.getAttribute("BEAT_ATTRIBUTE") : beat;
    if (next !== beat || document.hidden) {
      beat = next;
      silence = 0;
      since = now;
    } else {
      silence += waited;
    }
    const lost = silence > LONGEST;
    document.documentElement.classList.toggle("foretouch-lost", lost);
    box.style.display = lost ? "block" : "none";
    if (!lost) {
      text.textContent = "";
      told = -Infinity;
    }
    if (lost && now - told > TOLD_AGAIN) {
      told = now;
      const seconds = Math.round((now - since) / 1000);
      text.textContent =
        beat === ""
          ? "It is still loading, or the console refuses it. No emergency stop from here yet."
          : `Nothing has come from it for ${Math.max(seconds, 1)} s. What is pressed here may not arrive, nor may the ` +
            "emergency stop (Space): stop the robot at its own machine, or with \u201cforetouch stop\u201d. " +
            "A console that was started again has a new address, in its terminal.";
    }
  };
  document.documentElement.append(style, box);
  look();
})();

// The second tab: a recording is read, learnt from and predicted at a delay, here on this machine.

const FLOOR = 0.05; // Least force that counts as contact [N]
const SCORED_FROM = 1.5; // Time after the first sample from which on errors count [s]
const TOUCH = 0.05; // Time over which the lowest mean of the force is its zero [s]
const LARGEST_FILE = 200e6; // [bytes]

let table = null, trialOf = null, result = null, serial = 0;

// A table of text: names, and a column of numbers each.
function parseTable(text) {
  const lines = text.replace(/^\uFEFF/, "").split(/\r?\n/).filter((line) => line.trim());
  const { at, separator, names } = headerOf(lines);
  const below = lines.slice(at + 1).filter((line) => !REMARK.test(line)).map((line) => cellsOf(line, separator));
  const commas = below.slice(0, LOOKED_AT).some((row) => row.some((cell) => /^[-+]?\d*,\d+(e[-+]?\d+)?$/i.test(cell)));
  const number = (cell = "") => (commas && cell.includes(".") ? NaN : numberIn(cell)); // there a point is of thousands
  const rows = below.filter((row) => row.some((cell) => Number.isFinite(number(cell))));
  if (rows.length < 100) throw new Error(`it has too few rows of numbers (${rows.length}): some seconds of presses are needed`);
  const units = below[0] !== rows[0] ? below[0] : []; // a row of words below the names
  return { names, units, columns: names.map((_, k) => Float64Array.from(rows, (row) => number(row[k]))) };
}

const LOOKED_AT = 50; // Lines within which the names stand, and which tell whether numbers have a decimal comma
const FEWEST = 3; // Columns that are needed: time, position and force
const REMARK = /^\s*(?:[#%]|\/\/)+\s*/;

// The cells of a line; what separates them may stand in one that is quoted.
function cellsOf(line, separator) {
  if (!line.includes('"')) return line.split(separator).map((cell) => cell.trim());
  const cells = [""];
  let quoted = false;
  for (const letter of line) {
    if (letter === '"') quoted = !quoted;
    else if (letter === separator && !quoted) cells.push("");
    else cells[cells.length - 1] += letter;
  }
  return cells.map((cell) => cell.trim());
}

// The number in a cell with a decimal point or comma; a comma that separates cells is in no cell but a quoted one.
const numberIn = (cell) => (cell === "" ? NaN : Number(cell.replace(",", ".")));
const numbersIn = (cells) => cells.filter((cell) => Number.isFinite(numberIn(cell))).length;
const unitIn = (cell = "") => cell.replace(/[()[\]]/g, "").toLowerCase().replace("\u03bc", "µ"); // a Greek mu means the same
const areUnits = (cells) => cells.some((cell) => Object.values(KINDS).some(([, units]) => unitIn(cell) in units));

// The line that names the columns: other lines may stand above it, and it may itself be a remark, as NumPy writes it.
function headerOf(lines) {
  const found = lines.slice(0, LOOKED_AT).map((line, at) => {
    const plain = line.replace(REMARK, ""), width = (separator) => cellsOf(plain, separator).length;
    const separator = [",", ";", "\t"].reduce((widest, one) => (width(one) > width(widest) ? one : widest));
    return { at, separator, names: cellsOf(plain, separator), remark: REMARK.test(line) };
  }).filter(({ names }) => names.filter(Boolean).length >= FEWEST && 2 * numbersIn(names) < names.length);
  const overNumbers = ({ at, separator, names }) => {
    const [next = [], after = []] = lines.slice(at + 1, at + 3).map((line) => cellsOf(line, separator));
    const first = areUnits(next) && numbersIn(next) === 0 ? after : next;
    return first.length === names.length && numbersIn(first) >= FEWEST;
  };
  const header = found.find(overNumbers) ?? found.find(({ remark }) => !remark); // numbers may be missing in the first row
  if (!header) throw new Error("no line names columns of time, position and force, separated by commas, semicolons or tabs");
  return header;
}

const KINDS = {
  time: [/^(time|t|zeit|timestamp|temps|tiempo)\b|^(time|t)_/i, { s: 1, ms: 0.001, us: 0.000001, "µs": 0.000001, ns: 1e-9 }],
  position: [/^(position|pos|x|z|depth|weg|displacement|indentation|stroke|extension)\b|^(position|pos|depth|displacement)_/i, { m: 1, cm: 0.01, mm: 0.001, um: 0.000001, "µm": 0.000001 }],
  force: [/^(force|f|fz|load|kraft|fuerza)\b|^(force|load)_/i, { n: 1, mn: 0.001, cn: 0.01, kn: 1000 }],
};

function guess({ names, units: below }) {
  for (const [kind, [pattern, units]] of Object.entries(KINDS)) {
    const select = $(`${kind}-column`);
    select.replaceChildren(...names.map((name, k) => new Option(name, k)));
    const found = names.findIndex((name) => pattern.test(name));
    select.value = found < 0 ? Math.min(Object.keys(KINDS).indexOf(kind), names.length - 1) : found;
    const named = /(?:_|\(|\[|\s)([a-zµμ]+)[)\]]?\s*$/i.exec(names[select.value])?.[1];
    $(`${kind}-unit`).value = String(units[unitIn(named)] ?? units[unitIn(below[select.value])] ?? 1);
  }
}

// Say what is the matter with a file, and show nothing of the one before.
function refuse(text) {
  table = result = null;
  serial++;
  say("file-says", text);
  say("trial-says", "");
  $("columns").disabled = $("scores").hidden = true;
  drawTrial();
}

function load(text, name) {
  try {
    table = parseTable(text);
  } catch (error) {
    refuse(`${name}: ${error.message}`);
    return;
  }
  guess(table);
  $("columns").disabled = false;
  say("file-says", `${name}: ${table.columns[0].length} samples`);
  startTrial();
}

function chosen() {
  const column = (kind, sign) => {
    const unit = Number($(`${kind}-unit`).value) * sign;
    const from = table.columns[Number($(`${kind}-column`).value)];
    return unit === 1 ? from : from.map((value) => value * unit);
  };
  const all = [column("time", 1), column("position", $("flip").checked ? -1 : 1), column("force", $("flip-force").checked ? -1 : 1)];
  const good = [];
  for (let k = 0, last = -Infinity; k < all[0].length; k++) {
    if (all.every((values) => Number.isFinite(values[k])) && all[0][k] > last) { last = all[0][k]; good.push(k); }
  }
  const [time, position, force] = all.map((values) => Float64Array.from(good, (k) => values[k]));
  return { time, position, force };
}

function startTrial() {
  if (!table) return;
  const delay = Number($("trial-delay").value) / 1000;
  trialOf = { ...chosen(), delay };
  const { time } = trialOf;
  result = null;
  serial++; // what is still computed for another choice is not waited for
  if (time.length < 100 || !(time[time.length - 1] - time[0] > delay)) {
    say("trial-says", "Too few samples in these columns, or a recording that is shorter than the delay.");
    $("scores").hidden = true;
    drawTrial();
    return;
  }
  say("trial-says", "Computing…");
  worker.postMessage({ to: "trial", id: serial, ...trialOf });
}

heard.progress = (message) => { if (message.id === serial) say("trial-says", `Computing… ${Math.round(100 * message.done)} %`); };
heard.trial = (message) => {
  if (message.id !== serial) return;
  result = scored(trialOf, message.predicted);
  showScores(trialOf.delay);
  drawTrial();
};

// ---- Scores, as `foretouch predict` has them ----

// The value below which this percentage lies, straight between two of them, of values that are sorted.
function percentile(sorted, percent) {
  const at = (percent / 100) * (sorted.length - 1), low = Math.floor(at);
  return low + 1 < sorted.length ? sorted[low] + (at - low) * (sorted[low + 1] - sorted[low]) : sorted[low];
}
const median = (values) => percentile(Float64Array.from(values).sort(), 50);

function lowestMean(time, force) {
  const period = median(time.slice(1).map((t, k) => t - time[k])), sums = [0], means = [];
  force.forEach((value) => sums.push(sums[sums.length - 1] + value));
  for (let k = 0, first = 0; k < time.length; k++) {
    while (time[first] <= time[k] - TOUCH + 1e-3 * period) first++;
    if (time[k] - time[0] >= TOUCH - 1.001 * period) means.push({ held: k + 1 - first, mean: (sums[k + 1] - sums[first]) / (k + 1 - first) });
  }
  if (!means.length) return sums[force.length] / force.length;
  const least = Math.min(10, median(means.map((one) => one.held)));
  return means.reduce((lowest, { held, mean }) => (held >= least ? Math.min(lowest, mean) : lowest), Infinity);
}

// Slope of the force over the position at chosen samples, by least squares.
function slope(position, force, chosen) {
  const rows = [...force.keys()].filter(chosen);
  if (rows.length < 3) return 0;
  const mean = (values) => rows.reduce((sum, k) => sum + values[k], 0) / rows.length, x = mean(position), f = mean(force);
  let products = 0, squares = 0;
  for (const k of rows) { products += (position[k] - x) * (force[k] - f); squares += (position[k] - x) ** 2; }
  return squares > 0 ? products / squares : 0;
}

// The zero of the force: the median over the outermost tenth of positions where the force is level there, as it is in
// free air; else the lowest mean.
function zeroOf({ time, position, force }) {
  const outermost = percentile(Float64Array.from(position).sort(), 10), outside = (k) => position[k] <= outermost;
  const middle = median(force.filter((_, k) => outside(k)));
  const threshold = Math.max(0.05 * (percentile(Float64Array.from(force).sort(), 98) - middle), FLOOR);
  const contact = slope(position, force, (k) => force[k] > middle + threshold);
  return Math.abs(slope(position, force, outside)) <= 0.05 * contact ? middle : lowestMean(time, force);
}

function scored(data, predicted) {
  const { time, force, delay } = data, zero = zeroOf(data), count = time.length;
  const measured = force.map((value) => value - zero), delayed = new Float64Array(count);
  const period = median(time.slice(1).map((t, k) => t - time[k]));
  for (let k = 0, at = -1; k < count; k++) {
    while (at + 1 < count && time[at + 1] <= time[k] - delay + 1e-3 * period) at++;
    delayed[k] = at < 0 ? 0 : measured[at];
  }
  const late = (k) => time[k] - time[0] >= SCORED_FROM - 1e-3 * period;
  const window = measured.filter((_, k) => late(k)).sort();
  const threshold = Math.max(0.05 * percentile(window, 98), FLOOR);
  const sums = { force: 0, contact: 0, predicted: 0, scored: 0, delayed: 0 };
  for (let k = 0; k < count; k++) {
    if (!late(k)) continue;
    const contact = measured[k] > threshold;
    if (contact) { sums.contact++; sums.force += measured[k] ** 2; sums.delayed += (delayed[k] - measured[k]) ** 2; }
    if (contact || predicted[k] > threshold) { sums.scored++; sums.predicted += (predicted[k] - measured[k]) ** 2; }
  }
  const rms = Math.sqrt(sums.force / sums.contact);
  return { time, measured, predicted, delayed, rms, zero,
    predicted_rms: Math.sqrt(sums.predicted / sums.scored), delayed_rms: Math.sqrt(sums.delayed / sums.contact) };
}

function showScores(delay) {
  const { rms, predicted_rms: now, delayed_rms: late } = result, percent = (value) => `${((100 * value) / rms).toFixed(1)} %`;
  const known = Number.isFinite(rms);
  $("scores").hidden = !known;
  if (!known) { say("trial-says", "No contact was found after the first 1.5 s: look at the columns and their signs."); return; }
  say("predicted-rms", `${now.toPrecision(3)} N`);
  say("predicted-percent", percent(now));
  say("delayed-rms", `${late.toPrecision(3)} N`);
  say("delayed-percent", percent(late));
  const ratio = late / now;
  say("trial-says", delay === 0 ? "Without a delay there is nothing to predict." : ratio > 1
    ? `The prediction is ${ratio.toFixed(1)} times as near to the measured force as the force that is ${Math.round(1000 * delay)} ms late.`
    : "Here the delayed force is nearer: nothing of what is predicted had been felt before, or the columns are wrong.");
}

function drawTrial() {
  if ($("recording").hidden) return;
  const canvas = $("trial-plot");
  if (!result) { axes(canvas, 0, 10, 0, 5, " s"); return; }
  const { time, measured, predicted, delayed } = result, start = time[0], length = time[time.length - 1] - start;
  const wide = Math.min(Number($("window").value) || length, length), from = start + Number($("from").value) * (length - wide);
  $("from").disabled = wide >= length;
  const first = Math.max(time.findIndex((t) => t >= from), 0);
  let last = time.findIndex((t) => t > from + wide);
  if (last < 0) last = time.length;
  const step = Math.max(1, Math.floor((last - first) / 4000)), count = Math.ceil((last - first) / step);
  let low = 0, high = 0.1;
  for (let k = first; k < last; k += step) {
    high = Math.max(high, measured[k], delayed[k], Math.min(predicted[k], 20 * result.rms));
    low = Math.min(low, measured[k], predicted[k]);
  }
  const placed = axes(canvas, from - start, from - start + wide, Math.max(low, -high) * 1.1, high * 1.1, " s");
  const at = (k) => time[first + k * step] - start, value = (values) => (k) => values[first + k * step];
  curve(placed, count, at, value(delayed), colours.late, [7, 4], 1.8);
  curve(placed, count, at, value(measured), colours.true, [2, 2], 2.2);
  curve(placed, count, at, value(predicted), colours.now, [], 1.8);
}

function bindRecording() {
  const take = async (file) => {
    if (!file) return;
    if ($("recording").hidden) $("tab-recording").click();
    if (file.size > LARGEST_FILE) { refuse(`${file.name} has more than 200 MB: a part of it is enough`); return; }
    try {
      load(await file.text(), file.name);
    } catch (error) { // a folder, or a file that is gone
      refuse(`${file.name} cannot be read: ${error.message}`);
    }
  };
  $("file").addEventListener("change", () => {
    take($("file").files[0]);
    $("file").value = ""; // so that the same file may be chosen again, once it is mended
  });
  $("example").addEventListener("click", () => load(CONTENT.example, "example.csv, a press of simulated foam"));
  addEventListener("dragover", (event) => { event.preventDefault(); document.body.classList.add("over"); });
  addEventListener("dragleave", () => document.body.classList.remove("over"));
  addEventListener("drop", (event) => { event.preventDefault(); document.body.classList.remove("over"); take(event.dataTransfer.files[0]); });
  for (const kind of Object.keys(KINDS)) for (const part of ["column", "unit"]) $(`${kind}-${part}`).addEventListener("change", startTrial);
  for (const id of ["flip", "flip-force"]) $(id).addEventListener("change", startTrial);
  const delay = () => say("trial-delay-says", `${$("trial-delay").value} ms`);
  $("trial-delay").addEventListener("input", delay);
  $("trial-delay").addEventListener("change", startTrial);
  delay();
  for (const id of ["window", "from"]) $(id).addEventListener("input", drawTrial);
  addEventListener("resize", drawTrial);
}

// ---- Begin ----

readColours();
bindControls();
bindHandle();
bindTabs();
bindRecording();
try {
  startWorker();
} catch (error) {
  fail(`This browser cannot run the page: ${error.message}`);
}

"use strict";
/* The controls of the page, and what it asks the server. A move of a slider is answered at once
   from interpolated cycles; when the slider rests, the cycle is simulated and the isolators are
   asked. */

const REST = 300;  /* time after the last move in which nothing moves [ms] */
const by = id => document.getElementById(id);
let offer, picture, answer = null, version = 0, moved = 0, resting = null;
const pick = {effect: null, axis: 1, severity: 0, speed: null, payload: null, temperature: null};

async function ask(path, told = {}) {
  const given = Object.entries(told).filter(([, value]) => value !== null && value !== "");
  const reply = await fetch(path + "?" + new URLSearchParams(given));
  const content = await reply.json();
  if (!reply.ok) throw new Error(content.error);
  return content;
}

/* ---- what is chosen ---- */

function effectNow() { return offer.effects.find(one => one.name === pick.effect); }
function axisNow() { return effectNow().axes[pick.axis - 1]; }
function query() {
  return {...pick, sensors: by("sensors").value, schedule: by("schedule").value,
          cycles: by("cycles").value};
}
function neat(value) { return Number(value.toPrecision(6)); }

/* Percent for fractions, otherwise the SI unit. */
function severityScale() {
  const {units} = axisNow();
  return units === "1" ? [100, "%"] : [1, units];
}

function option(select, value, text, whyNot) {
  const one = new Option(whyNot ? `${text} – ${whyNot}` : text, value);
  one.disabled = Boolean(whyNot);
  select.add(one);
}

function fillControls() {
  by("title").textContent = `${offer.robot} at ${offer.task.split(/[\\/]/).pop()}`;
  by("description").textContent = offer.description;
  for (const one of offer.effects) {
    const possible = one.axes.some(axis => !axis.why_not);
    option(by("effect"), one.name, one.name, possible ? "" : one.axes[0].why_not);
  }
  for (const one of offer.schedules) option(by("schedule"), one.name, one.name);
  for (const one of offer.sensors) {
    option(by("sensors"), one.name, one.name);
    by("sensors").lastChild.disabled = Boolean(one.why_not);
  }
  by("cycles").max = offer.most_cycles;
  for (const name of ["speed", "payload", "temperature"]) {
    const slider = by(name), {low, high, usual, why_not: whyNot} = offer[name];
    Object.assign(slider, {min: 0, max: 60, step: 1, disabled: Boolean(whyNot)});
    slider.value = Math.round(60 * (usual - low) / (high - low));
    showOperation(name);
  }
  by("payload-why").textContent = offer.payload.why_not;
  const usual = offer.effects.find(one => one.axes.some(axis => !axis.why_not));
  chooseEffect((offer.effects.find(one => one.name === "friction_wear") || usual).name);
}

/* An operation that is not moved is not stated, so that the model's own value holds. */
function readOperation(name) {
  const {low, high, usual} = offer[name], slider = by(name);
  const start = Math.round(60 * (usual - low) / (high - low));
  const value = neat(low + (high - low) * slider.value / 60);
  pick[name] = Number(slider.value) === start ? null : Number(value.toPrecision(3));
  showOperation(name);
}

function showOperation(name) {
  const value = pick[name] ?? offer[name].usual;
  by(name + "-value").textContent = offer[name].why_not ? "" :
    {speed: `${Math.round(100 * value)} %`, payload: `${Number(value.toPrecision(3))} kg`,
     temperature: `${Number(value.toPrecision(3))} °C`}[name];
}

function chooseEffect(name) {
  pick.effect = by("effect").value = name;
  const effect = effectNow(), box = by("axes");
  by("about").textContent = `${sentence(effect.description)} ${sentence(effect.signature)}`;
  const free = axis => axis && !axis.why_not;
  if (!free(effect.axes[pick.axis - 1]))
    pick.axis = effect.usual_axis || effect.axes.find(free).axis;
  box.replaceChildren(...effect.axes.map(({axis, why_not: whyNot}) => {
    const label = document.createElement("label"), input = document.createElement("input");
    label.className = "chip";
    label.title = whyNot || offer.axes[axis - 1];
    Object.assign(input, {type: "radio", name: "axis", value: axis, disabled: Boolean(whyNot),
                          checked: axis === pick.axis});
    label.append(input, String(axis));
    return label;
  }));
  const reasons = new Set(effect.axes.map(axis => axis.why_not).filter(Boolean));
  by("axis-why").textContent = [...reasons].join("; ");
  pick.severity = axisNow().usual;
  showSeverity();
}

function sentence(text) { return text[0].toUpperCase() + text.slice(1) + "."; }

function showSeverity() {
  const {top, largest, unit: words} = axisNow(), [scale, unit] = severityScale();
  by("severity").value = Math.round(100 * pick.severity / top);
  by("severity-number").value = neat(scale * pick.severity);
  by("severity-unit").textContent = unit;
  const more = largest > top ? ` The slider ends at ${neat(scale * top)} ${unit}; up to
    ${neat(scale * largest)} ${unit} can be typed.` : "";
  by("severity-hint").textContent = (words ? `Unit: ${words}.` : "") + more;
}

/* ---- what is shown ---- */

function say(text, isError = false) {
  by("status").textContent = text;
  by("status").classList.toggle("error", isError);
  by("plots").classList.toggle("waits", isError || !answer);
}

function draw() {
  if (!answer) return;
  const name = offer.axes[answer.axis - 1];
  by("torque-title").textContent = `Motor torque of ${name}`;
  by("friction-title").textContent = `Friction of ${name}`;
  drawTorque(by("torque"), answer);
  if (!draw.later) draw.later = setTimeout(drawRest, 2 * (draw.took || 10));
}

/* What may come later, so that the torque follows the slider at once: the slower the browser, the
   more seldom. */
function drawRest() {
  const started = performance.now();
  drawFriction(by("friction"), answer);
  drawBars(by("bars"), answer, by("histogram").value);
  by("rms").replaceChildren(...offer.axes.map((text, k) => {
    const usual = answer.healthy.rms[k], now = answer.now.rms[k];
    const change = usual ? 100 * (now / usual - 1) : 0;
    return row([text, usual.toPrecision(3), now.toPrecision(3),
                `${change >= 0.005 ? "+" : change <= -0.005 ? "−" : ""}${
                  Math.abs(change).toFixed(2)} %`],
               "number");
  }));
  draw.later = 0;
  draw.took = Math.min(performance.now() - started, 200);
}

function row(cells, kind) {
  const line = document.createElement("tr");
  cells.forEach((text, k) => {
    const cell = document.createElement("td");
    if (k) cell.className = kind;
    cell.textContent = text;
    line.append(cell);
  });
  return line;
}

function showVerdict(told) {
  const truth = pick.severity ? `axis ${pick.axis}` : "none";
  by("verdict-hint").textContent = `Asked about a run of ${told.cycles} cycles with this fault (right: `
    + `${truth}). The noise is that of the preset ${told.noise}. Each isolator has learned from `
    + `${told.series} healthy series of as many cycles. They look for friction wear, so that other `
    + `faults are often missed or taken for it.`;
  by("verdict").replaceChildren(...told.rows.map(one => {
    const line = row([one.name, one.why_not || (one.axis ? `axis ${one.axis}` : "none"), ""], "");
    line.children[0].title = one.idea;
    if (one.why_not) return line;
    line.children[1].className = one.right ? "right" : "wrong";
    if (one.severity) {
      const [value, low, high] = one.severity.map(part => (100 * part).toPrecision(3));
      line.children[2].textContent = `${value} % (95 %: ${low} to ${high} %)`;
    }
    return line;
  }));
  by("verdict").classList.remove("waits");
}

/* ---- what is asked ---- */

let asking = false, again = false;

/* The answer from interpolated cycles; at most one request is under way. */
async function quick() {
  if (asking) { again = true; return; }
  asking = true;
  do {
    again = false;
    const started = moved, number = version, {axis} = pick;
    try {
      const told = await ask("signals", query());
      by("command").textContent = told.command;
      if (number !== version && !told.ready) continue;
      if (told.ready) {
        answer = {...told, axis};
        draw();
        const took = Math.round(performance.now() - started);
        document.body.dataset.took = took;
        say(`${told.how} ${told.note} Answered in ${took} ms.`);
      } else say("Simulating …");
    } catch (error) { say(error.message, true); }
  } while (again);
  asking = false;
}

async function rest() {
  const number = version;
  document.body.dataset.rests = "no";
  try {
    if (!answer || !answer.exact) say((answer ? answer.how + " " : "") + "Simulating this cycle …");
    const told = await ask("signals", {...query(), exact: 1});
    if (number !== version) return;
    answer = {...told, axis: pick.axis};
    by("command").textContent = told.command;
    draw();
    say(`${told.how} ${told.note}`);
    const poses = await ask("poses", query());
    if (number !== version) return;
    picture.show(poses);
    document.body.dataset.rests = "yes";
    by("verdict").classList.add("waits");
    if (!by("verdict").children.length)
      by("verdict-hint").textContent = "The isolators are learning how wear looks like; this "
        + "takes some seconds.";
    const verdict = await ask("verdict", query());
    if (number === version) showVerdict(verdict);
  } catch (error) {
    if (number === version) say(error.message, true);
  }
}

function change() {
  version += 1;
  moved = performance.now();
  picture.shares = pick.severity ? {[pick.axis]: 1} : {};
  picture.marked = pick.severity ? [pick.axis] : [];
  by("verdict").classList.add("waits");
  quick();
  clearTimeout(resting);
  resting = setTimeout(rest, REST);
}

function listen() {
  by("controls").addEventListener("submit", event => event.preventDefault());
  by("effect").addEventListener("change", event => { chooseEffect(event.target.value); change(); });
  by("axes").addEventListener("change", event => {
    pick.axis = Number(event.target.value);
    pick.severity = Math.min(pick.severity, axisNow().largest);
    showSeverity();
    change();
  });
  by("severity").addEventListener("input", event => {
    pick.severity = neat(axisNow().top * event.target.value / 100);
    showSeverity();
    change();
  });
  by("severity-number").addEventListener("change", event => {
    const value = Number(event.target.value) / severityScale()[0];
    pick.severity = Number.isFinite(value) ? neat(Math.max(0, Math.min(value, axisNow().largest)))
      : axisNow().usual;
    showSeverity();
    change();
  });
  for (const name of ["speed", "payload", "temperature"])
    by(name).addEventListener("input", () => { readOperation(name); change(); });
  for (const name of ["cycles", "schedule", "sensors"])
    by(name).addEventListener("change", change);
  by("histogram").addEventListener("change", draw);
  by("copy").addEventListener("click", copy);
  new ResizeObserver(draw).observe(by("plots"));
  darkness.addEventListener("change", draw);
}

async function copy() {
  const text = by("command").textContent;
  try {
    await navigator.clipboard.writeText(text);
  } catch {  /* some browsers allow it only in this older way */
    const chosen = getSelection();
    chosen.selectAllChildren(by("command"));
    document.execCommand("copy");
  }
  by("copy").textContent = "Copied";
  setTimeout(() => { by("copy").textContent = "Copy"; }, 1500);
}

async function begin() {
  offer = await ask("state");
  picture = new RobotPicture(by("robot"), offer.scene);
  picture.show(offer.poses);
  fillControls();
  by("dataset-hint").textContent = ["One healthy run and one with the fault. The severity is "
    + "reached in the last cycle, which is shown.", ...offer.sensors.filter(one => one.why_not)
    .map(one => `Noise ${one.name} cannot be shown: ${one.why_not}.`)].join(" ");
  listen();
  new Motion(picture, by("play"), time => { if (answer) moveCursor(by("torque"), time); });
  change();
}

begin().catch(error => say("The page cannot start: " + error.message, true));

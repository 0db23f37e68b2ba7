// Page "Now": shows what the server streams, and sends orders. All text goes in as text, never as HTML.
import { $, el, entries, get, number, post, said, svg, t, time } from "/static/shared.js";
import { Coverage } from "/static/coverage.js";
import { showStart } from "./start.js";
import { follow } from "./stream.js";
import { LIGHT_WORDS, VERDICT_WORDS, headline, stateWords } from "./words.js";

const SIGNAL_WORDS = {
  estop_ok: "Emergency stop released", guard_closed: "Door closed", supply_ok: "Supply",
  part_in_nest: "Part in the fixed gripper's barrier", part_in_gripper: "Part in the arm gripper's barrier",
  acknowledge: "Acknowledge button",
};
const ENTRY_WORDS = {
  "serial number": "Serial number",
};
let last = null;
let isLost = true;
let isActing = false;
const shown = new Map();

// Draws a section anew only where its content has changed, so that focus and selection stay.
function onChange(name, content, draw) {
  const text = JSON.stringify(content);
  if (shown.get(name) === text) return;
  shown.set(name, text);
  draw(content);
}

function show(now) {
  last = now;
  const { status, run } = now;
  onChange("run", [run && run.run, run && run.emulated.length], () => {
    $("run").textContent = run ? `${t("Run")} ${run.run}${run.emulated.length ? ` · ${t("emulated")}` : ""}` : "";
  });
  onChange("light", now.light, (light) => {
    for (const lamp of document.querySelectorAll("[data-light]")) {
      lamp.classList.toggle("lit", lamp.dataset.light === light);
    }
    $("light").textContent = t(LIGHT_WORDS[light]);
  });
  const hasBrokenOff = Boolean(run && !run.end && !now.runs && !now.preparing);
  onChange("state", [now.state, hasBrokenOff, Boolean(now.preparing), Boolean(now.unfinished)], () => {
    const name = headline(now);
    $("state-name").textContent = name;
    document.title = `${name} · cellctl`;
  });
  const doing = [];
  if (now.preparing) {
    doing.push(t("Run {run} of {user} is being prepared: its recipes are checked and planned, then the cell is connected (process {pid}, since {time}).", { ...now.preparing, time: time(now.preparing.since) }));
  }
  if (now.ending) doing.push(t("The run is at rest; its report is being written."));
  if (now.silent) doing.push(t("The cell does not answer: {why}", { why: said(now.silent) }));
  if (now.unfinished) doing.push(t("A part was left in a gripper: {evidence}. Nothing moves before somebody decides.", { evidence: now.unfinished.evidence.map(said).join("; ") }));
  if (now.journal) doing.push(t("The journal cannot be read: {why}", { why: said(now.journal) }));
  if (status) {
    if (status.label) doing.push(said(status.label));
    if (status.safe_point) doing.push(said(status.safe_point));
    if (status.message) doing.push(said(status.message));
  } else if (!now.runs && run && (run.end || !now.unfinished)) {
    doing.push(run.end ? t("The last run ended: {end}. {message}", { end: said(run.end.end), message: said(run.end.message) }) : t("The last run broke off: `cellctl recover` says what the grippers may hold."));
  } else if (!run && !now.preparing) {
    doing.push(t("Start one here, or with `cellctl run`; it shows here by itself."));
  }
  onChange("is drawn", Boolean(run), (is) => {
    $("scene").hidden = !is || scene === false;
    if (!is) $("scene-words").textContent = t("The first run draws its cell here.");
  });
  onChange("doing", doing, () => { $("doing").textContent = doing.join(" · "); });
  onChange("facts", factsOf(now), (found) => $("facts").replaceChildren(...entries(found)));
  onChange("start", [now.runs, Boolean(status), now.started, now.unfinished], () => showStart(now));
  onChange("question", status && status.question, drawQuestion);
  onChange("acts", [status && [status.pause_seconds, status.pausing, status.first_motion, status.barred, status.state], now.runs, isLost], drawActs);
  onChange("alarms", [status ? status.alarms : [], run ? run.alarms : []], drawAlarms);
  onChange("steps", [run && run.plan, status && status.step], drawSteps);
  onChange("views", [run && run.run, run && run.views, run && run.table], drawViews);
  onChange("interlocks", [status ? status.signals : {}, now.runs], drawInterlocks);
  onChange("parts", [run && run.parts, run && run.counts, run && run.count], drawParts);
  onChange("files", [run && run.run, Boolean(run && run.end && run.parts.length)], drawFiles);
  onChange("people", run ? run.acts : [], drawPeople);
}

function factsOf({ status, run, unfinished }) {
  const found = [];
  if (!run) return found;
  found.push([t("Recipe"), run.at_hand.recipe || t("not recognised yet")]);
  if (run.part) found.push([t("Part"), run.count ? t("{k} of {n}", { k: run.part, n: run.count }) : String(run.part)]);
  if (run.at_hand.serial) found.push([t("Serial number"), run.at_hand.serial]);
  if (run.lot) found.push([t("Lot"), run.lot]);
  if (run.order_number) found.push([t("Order number"), run.order_number]);
  if (run.operator) found.push([t("Operator"), run.operator]);
  found.push([t("Custody"), t(unfinished ? unfinished.custody : status ? status.custody : run.custody)]);
  if (status && status.step_count) found.push([t("Step"), t("{k} of {n}", { k: status.step, n: status.step_count })]);
  if (status && status.seconds_left !== null) found.push([t("Left, about"), `${number(status.seconds_left)} s`]);
  if (run.verdict) found.push([t("Verdict"), t(VERDICT_WORDS[run.verdict.verdict] || run.verdict.verdict)]);
  return found;
}

function drawQuestion(question) {
  $("question").hidden = !question;
  if (!question) return;
  $("question-head").textContent = t("Question {n}", { n: question.number });
  $("question-text").textContent = said(question.text);
  $("choices").replaceChildren(...question.choices.map((choice) => {
    const button = el("button");
    button.type = "button";
    button.dataset.answer = choice.key;
    button.append(el("b", choice.words ? said(choice.words) : choice.key));
    button.append(el("small", choice.first ? t("moves first: {what}", { what: said(choice.first) }) : choice.key));
    button.disabled = document.querySelector("main").dataset.mayAct !== "yes";
    button.addEventListener("click", () => act("answer", { key: choice.key, number: question.number }));
    return button;
  }));
  drawEntry(question);
}

// A text in place of a choice. The field has the focus, so that what a scanner types arrives there.
function drawEntry(question) {
  const mayAct = document.querySelector("main").dataset.mayAct === "yes";
  $("entry").hidden = !question.entry;
  $("entry-said").textContent = "";
  if (!question.entry) return;
  $("entry-words").textContent = t(ENTRY_WORDS[question.entry] || question.entry);
  $("entry-text").value = "";
  for (const one of $("entry").querySelectorAll("input, button")) one.disabled = !mayAct;
  if (mayAct) $("entry-text").focus();
}

async function enter(event) {
  event.preventDefault();
  const question = last && last.status && last.status.question;
  const key = $("entry-text").value.trim();
  if (!question || !key) return;
  $("entry-said").textContent = "";
  if (await act("answer", { key, number: question.number })) return;
  // the next number, typed or scanned, replaces the one that was refused
  $("entry-said").textContent = $("said").textContent;
  $("entry-text").select();
}

function within(seconds) {
  return seconds === null || seconds === undefined
    ? t("nobody knows when it stands") : t("stands within {s} s", { s: number(Math.ceil(seconds)) });
}

function drawActs() {
  if (!$("buttons")) return;
  const status = last && last.status;
  const isThere = Boolean(status) && !isLost;
  const state = status ? status.state : "";
  for (const button of document.querySelectorAll("[data-pause]")) {
    const kind = button.dataset.pause;
    const can = isThere && kind in status.pause_seconds;
    button.disabled = !can;
    const words_ = can ? within(status.pause_seconds[kind]) : t("not now");
    button.querySelector("small").textContent = status && status.pausing === kind ? `${t("pausing")}, ${words_}` : words_;
  }
  const first = status && status.first_motion;
  const isPaused = isThere && state.startsWith("suspended");
  const barred = isPaused ? status.barred : "";
  $("ack").hidden = !barred;
  $("ack").querySelector("small").textContent = t("with a reason, above; then resume");
  $("resume").disabled = !isPaused || Boolean(barred);
  $("resume").querySelector("small").textContent = barred ? said(barred) : isPaused
    ? (first ? t("moves first: {what}", { what: said(first.words) }) : t("what moves first is not known yet"))
    : t("the cell is not paused");
  $("stop").disabled = !isThere;
}

function drawAlarms([standing, past]) {
  const row = (alarm, isStanding) => {
    const item = el("li", "", isStanding ? "standing" : "");
    const when = isStanding ? t("stands now") : `${time(alarm.at)}${alarm.times > 1 ? ` · ${t("{n} times", { n: alarm.times })}` : ""}`;
    item.append(el("b", `▲ ${alarm.number} ${said(alarm.words)}`), el("p", `${alarm.severity ? `${t(alarm.severity)} · ` : ""}${when}`, "quiet"));
    if (alarm.message) item.append(el("p", `${t("Cause")}: ${said(alarm.message)}`));
    if (alarm.unknown && alarm.unknown !== "nothing") item.append(el("p", `${t("Not known since")}: ${said(alarm.unknown)}`));
    if (alarm.todo) item.append(el("p", `${t("What to do")}: ${said(alarm.todo)}`));
    return item;
  };
  // one that stands is in the journal, too
  const gone = past.filter((a) => !standing.some((b) => b.number === a.number && b.message === a.message));
  const every = [...standing.map((a) => row(a, true)), ...gone.map((a) => row(a, false))];
  $("alarms").replaceChildren(...(every.length ? every : [el("li", t("None."), "none")]));
}

function drawSteps([plan, step]) {
  const steps = plan ? plan.steps : [];
  $("course-words").textContent = steps.length
    ? t("Forecast of the plan: {s} s.", { s: number(plan.forecast_s) }) : t("There is no plan yet.");
  // a step that took far longer than any was forecast fills its row, and leaves the others their length
  const longest = Math.max(1, ...steps.map((one) => one.forecast_s));
  const most = Math.max(longest, ...steps.map((one) => Math.min(one.seconds || 0, 2 * longest)));
  $("steps").replaceChildren(...steps.map((one, k) => {
    const item = el("li");
    if (step === k + 1) item.setAttribute("aria-current", "step");
    const mark = one.seconds !== null ? "✓" : step === k + 1 ? "▶" : "·";
    item.append(el("span", `${mark} ${k + 1} ${said(one.label)}`));
    const actual = one.seconds === null ? "" : `${number(one.seconds, 1)} s`;
    item.append(el("span", `${actual} / ${number(one.forecast_s, 1)} s`, "seconds"));
    const bars = el("span", "", "bars");
    const bar = (kind, seconds) => {
      const made = el("span", "", `bar ${kind}`);
      made.style.width = `${Math.min(100, (100 * seconds) / most)}%`;
      bars.append(made);
    };
    bar("forecast", one.forecast_s);
    if (one.seconds !== null) bar(one.seconds > 1.25 * one.forecast_s ? "actual late" : "actual", one.seconds);
    item.append(bars);
    return item;
  }));
}

function drawViews() {
  const run = last.run;
  const views = run ? [...run.views].reverse() : [];
  const figures = [];
  for (const view of views) {
    if (!view.pictures.length) continue;
    figures.push(figureOf(run.run, view, view.pictures[0]));
  }
  if (!figures.length && run && run.table.length) {
    figures.push(figureOf(run.run, { view: t("the table") }, run.table[0]));
  }
  $("views").replaceChildren(...(figures.length ? figures : [el("p", t("No picture yet."))]));
}

function figureOf(run, view, picture) {
  const size = last.run.size; // the outline is in pixels of the whole picture
  const figure = el("figure");
  const box = el("div", "", "picture");
  const image = el("img");
  image.src = `/now/picture/${encodeURIComponent(run)}/${picture.picture}`;
  image.width = 640;
  image.height = Math.round((640 * size[1]) / size[0]);
  image.alt = t("Picture of view {view} under {lamp}", { view: view.view, lamp: said(picture.lamp) });
  box.append(image);
  if (view.outline) {
    const over = svg("svg", { viewBox: `0 0 ${size[0]} ${size[1]}`, "aria-hidden": "true" });
    over.append(svg("path", { class: "outline", d: view.outline.map(([x, y]) => `M${x} ${y}h.1`).join("") }));
    for (const finding of view.findings) {
      const [x0, y0, x1, y1] = finding.box;
      over.append(svg("rect", { class: "finding", x: x0 - 12, y: y0 - 12, width: x1 - x0 + 24, height: y1 - y0 + 24 }));
    }
    box.append(over);
  }
  const caption = el("figcaption", `${view.view}: `);
  let words_ = t("picture taken");
  if (view.judged) {
    words_ = !view.evaluated ? t("not evaluated: {why}", { why: said(view.reason) })
      : view.findings.length
        ? view.findings.map((f) => `⚠ ${said(f.kind)} ${number(f.size_mm, 1)} mm`).join(", ")
        : t("✓ no finding");
  }
  caption.append(words_);
  figure.append(box, caption);
  return figure;
}

function drawInterlocks([signals, runs]) {
  const rows = Object.entries(signals).map(([name, isOk]) => {
    const item = el("li");
    const sign = isOk === null ? "?" : isOk ? "●" : "○";
    const word = isOk === null ? t("unknown") : isOk ? t("yes") : t("no");
    item.append(el("span", sign, "sign"), `${t(SIGNAL_WORDS[name] || name)}: ${word}`);
    return item;
  });
  $("interlocks").replaceChildren(...(rows.length ? rows : [el("li", runs ? t("Not read yet.") : t("Nobody reads them: no run."))]));
}

function drawParts([parts, counts]) {
  $("counts").textContent = counts
    ? Object.entries(counts).map(([verdict, n]) => `${t(VERDICT_WORDS[verdict] || verdict)}: ${n}`).join(" · ") : "";
  const rows = [...(parts || [])].reverse().map((one) =>
    el("li", `${[`${t("Part")} ${one.part}`, one.serial, one.recipe].filter(Boolean).join(" · ")}: ${t(VERDICT_WORDS[one.verdict] || one.verdict)}${one.tray ? ` → ${said(one.tray)}` : ""}`));
  $("parts").replaceChildren(...(rows.length ? rows : [el("li", t("No part is done yet."))]));
}

// The report of a run is there once it has ended, with a part at least.
function drawFiles([run, isThere]) {
  $("files").hidden = !isThere;
  if (!isThere) return;
  $("files").replaceChildren(el("span", `${t("Report of the run")}:`), ...["html", "pdf", "csv", "qif", "as9102"].map((form) => {
    const link = el("a", form.toUpperCase(), "button");
    link.href = `/history/file/${encodeURIComponent(run)}/${form}`;
    link.setAttribute("aria-label", `${t("Report of the run")}: ${form.toUpperCase()}`);
    return link;
  }));
}

function drawPeople(acts) {
  $("people").replaceChildren(...(acts.length ? acts.map((one) => el("li",
    `${time(one.at)} ${one.who}: ${said(one.act).replaceAll("_", " ")}${one.why ? ` (${one.why})` : ""}${one.answer === "handled" ? "" : `: ${t(one.answer)}`}`))
    : [el("li", t("Nobody yet."))]));
}

// Sends an order; returns whether it was taken.
async function act(name, body) {
  if (isActing) return false;
  isActing = true;
  $("said").textContent = t("sent …");
  const why = $("why") ? $("why").value : "";
  try {
    const reply = await post(`/now/act/${name}`, { ...body, why });
    if (reply.error) $("said").textContent = `✗ ${said(reply.error)}`;
    else if (reply.decision === "refused") $("said").textContent = `✗ ${t("refused")}: ${said(reply.reason)}`;
    else if (reply.decision === "ignored") $("said").textContent = `– ${t("nothing to do")}: ${said(reply.reason)}`;
    else {
      $("said").textContent = `✓ ${t("taken")}: ${stateWords(reply.state)}`;
      if ($("why")) $("why").value = "";
      return true;
    }
  } catch {
    $("said").textContent = `✗ ${t("The order did not reach the page. Look at the cell before you repeat it.")}`;
  } finally {
    isActing = false;
  }
  return false;
}

for (const button of document.querySelectorAll("[data-pause]")) {
  button.addEventListener("click", () => act("pause", { kind: button.dataset.pause }));
}
$("entry").addEventListener("submit", enter);
if ($("resume")) {
  $("resume").addEventListener("click", () => {
    const first = last && last.status && last.status.first_motion;
    act("resume", { first: first ? first.words : null });
  });
  $("ack").addEventListener("click", () => act("ack", {}));
  $("stop").addEventListener("click", () => act("stop", {}));
}
// The stream. The server sends a beat every 5 s; without one the connection counts as lost.
let scene = null;
let moment = null;
let ghost = null;
const coverage = new Coverage();

// Shows how old what is shown is; orders need a server that is heard.
function lose({ isSilent, words, age }) {
  $("lost").hidden = !last || !words;
  $("lost-words").textContent = words;
  $("age").textContent = last ? t("as of {s} s ago", { s: number(age / 1000) }) : "";
  if (isLost === isSilent) return;
  isLost = isSilent;
  drawActs();
}

function sceneWords() {
  if (scene === false || !moment) return;
  const stands = !moment.known ? t("Where the arm stands is not known yet.")
    : moment.moves ? t("The arm moves; between the ends of its path this is where its timing model has it.")
      : t("The arm stands.");
  const next = ghost ? ` ${t("Transparent, with an arrow: what moves first when you resume.")}` : "";
  $("scene-words").textContent = stands + next;
}

let sceneRun = "";
async function wantScene(run) {
  if (sceneRun === run) return;
  sceneRun = run;
  let mesh = {};
  try {
    mesh = await get("/now/mesh");
  } catch {
    sceneRun = ""; // the page's server is away; tried again
    return;
  }
  coverage.part(run, mesh);
  if (scene === false) return;
  try {
    const { CellView } = await import("./scene.js");
    if (!scene) scene = new CellView($("scene"));
    await scene.load(mesh);
    if (moment) scene.show(moment);
    scene.preview(ghost);
  } catch (error) {
    scene = false;
    $("scene").hidden = true;
    $("scene-words").textContent = t("The cell cannot be drawn in this browser: {why}", { why: error.message });
  }
}

follow({
  now: (now) => { show(now); if (now.run) wantScene(`${now.run.run} ${now.run.recipe}`); },
  moment: (found) => { moment = found; if (scene) scene.show(found); sceneWords(); },
  ghost: ({ motion }) => { ghost = motion; if (scene) scene.preview(motion); sceneWords(); },
  coverage: (found) => coverage.show(found),
}, lose);

// Page of one recipe: its part in three dimensions, tolerances in a table, plan and check.
import { $, el, entries, get, language, number, post, said as told, t } from "/static/shared.js";
import { addressOf, drawn, listenToCancel, said, STATE_WORDS, watch } from "/static/recipes/working.js";

const { key, own } = $("recipe").dataset;
const at = addressOf(key);
const may = $("content").dataset;
const mayChange = own === "yes" && may.mayEdit === "yes";
const ONE_SIDED = ["position", "straightness", "roundness"];

const LEGEND_WORDS = {
  seen: "in sight of some view", partly: "partly in sight", unseen: "in sight of no view",
  left_out: "not all in sight, and left out by the recipe", chosen: "chosen",
};

let facts = null;
let part = null;
let plan = null;
let check = null;
let view = null;
let meshOf = "";
let chosen = 0;
const changes = new Map(); // by id of a characteristic: what is changed of it
const settings = {};
let seen = "";

const percent = (share, digits = 1) => `${number(100 * share, digits)}\u00a0%`;
// A number as a person writes it in a field.
const plain = (value) => value.toLocaleString(language, { useGrouping: false, maximumFractionDigits: 6 });
const parsed = (text) => {
  const clean = text.trim().replace(",", ".");
  return /^\d+(\.\d*)?$|^\.\d+$/.test(clean) ? Number(clean) : NaN;
};

function mode() {
  return document.querySelector("[name=mode]:checked").value;
}

// Fills the fields of the section `inspection` as the file has it.
function fillSettings() {
  for (const input of document.querySelectorAll("[data-setting]")) {
    const value = facts.recipe.inspection[input.dataset.setting];
    input.value = typeof value === "number" ? plain(value) : value;
    input.disabled = !mayChange;
    input.setAttribute("aria-invalid", "false");
  }
}

async function load() {
  facts = await get(`/recipes/facts/${at}`);
  const words = facts.problem ? facts.file : t("{name}: part {part}, cell {cell}", facts);
  $("facts").textContent = words;
  $("problem").hidden = !facts.problem;
  $("problem").textContent = told(facts.problem);
  for (const kind of ["part", "plan", "check"]) {
    const work = facts.known[kind];
    const button = document.querySelector(`[data-work=${kind}]`);
    const state = work ? `${t(STATE_WORDS[work.state])}, ${number(work.seconds)} s` : t("not yet");
    button.querySelector("small").textContent = work && work.is_old ? `${state} (${t("before the last change")})` : state;
    button.disabled = may.mayAct !== "yes" || Boolean(facts.problem);
  }
  if (facts.recipe) {
    fillSettings();
    const left = Object.entries(facts.recipe.not_inspected);
    const list = el("ul");
    list.append(...left.map(([face, why]) => el("li", `${face}: ${why}`)));
    const head = el("summary", left.length === 1 ? t("1 face need not be inspected") : t("{n} faces need not be inspected", { n: left.length }));
    const box = el("details");
    box.append(head, list);
    $("not-inspected").replaceChildren(...(left.length ? [box] : []));
  }
  const found = await Promise.all(["part", "plan", "check"].map(async (kind) => {
    const work = facts.known[kind];
    return work && work.state !== "running" ? (await get(`/recipes/${kind}/${at}`)) : null;
  }));
  [part, plan, check] = found;
  await drawPart();
  drawTable();
  drawPlan();
  drawCheck();
}

async function drawPart() {
  const found = part && part.found;
  if (!found) {
    if (part) $("scene-words").textContent = part.work.messages.map((one) => told(one)).join(" ") || t(STATE_WORDS[part.work.state]);
    return;
  }
  const rows = [
    [t("Size"), `${found.size_mm.map((v) => number(v, 1)).join(" × ")} mm`],
    [t("Mass"), `${number(found.mass_g, 1)} g`],
    [t("Faces"), number(found.faces.length)],
    [t("Features"), found.features.length ? number(found.features.length) : t("none")],
  ];
  $("part-facts").replaceChildren(...entries(rows));
  const features = el("details");
  features.append(el("summary", t("Features")), el("p", found.features.map((one) => told(one.label)).join("; ")));
  $("warnings").replaceChildren(...found.warnings.map((text) => el("li", `⚠ ${told(text)}`)));
  $("features").replaceChildren(...(found.features.length ? [features] : []));
  $("no-poses").hidden = true;
  $("poses").replaceChildren(...found.poses.map((pose) => {
    const item = el("li");
    const button = el("button", "", "plain");
    button.type = "button";
    button.setAttribute("aria-pressed", String(pose.index === found.poses[0].index));
    const image = el("img");
    image.src = `/recipes/picture/${at}/part/${pose.picture}?made=${encodeURIComponent(part.work.seconds)}`;
    image.width = 420;
    image.height = 315;
    image.alt = t("Pose {n} at rest", { n: pose.index });
    const marks = [];
    if (pose.rolling) marks.push(t("rolls"));
    if (pose.marginal) marks.push(t("barely stable"));
    if (pose.same_as !== null && pose.same_as !== pose.index) marks.push(t("the same as pose {n}", { n: pose.same_as }));
    button.append(image, el("b", t("Pose {n}: {p}", { n: pose.index, p: percent(pose.probability) })), el("small", marks.join("; ")));
    button.addEventListener("click", () => {
      for (const other of $("poses").querySelectorAll("button")) other.setAttribute("aria-pressed", String(other === button));
      if (view) view.rest(pose.R);
    });
    item.append(button);
    return item;
  }));
  const mark = `${part.work.seconds}`;
  if (meshOf !== mark) {
    meshOf = mark;
    try {
      view = await drawn(await get(`/recipes/mesh/${at}`), choseFace);
      view.rest(found.poses.length ? found.poses[0].R : null);
      $("scene-words").textContent = t("Drag, pinch, or use the arrow keys, plus and minus. Click a face to find its characteristic.");
    } catch (error) {
      view = null;
      $("scene").hidden = true;
      $("scene-words").textContent = t("The part cannot be drawn in this browser: {why}", { why: told(error.message) });
    }
  }
  await drawMode();
}

async function drawMode() {
  const covered = plan && plan.found && plan.found.faces.length ? plan.found : null;
  const radio = document.querySelector("[name=mode][value=coverage]");
  radio.disabled = !covered;
  if (!covered && radio.checked) document.querySelector("[name=mode][value=numbers]").checked = true;
  if (!view) return;
  if (mode() === "coverage") {
    view.number([], 0);
    view.choose([]);
    view.show(new Map(covered.faces.map((face) => [face.face, face.state])));
    view.mark(covered.unseen.flatMap((piece) => piece.points));
    await legend(covered.faces);
  } else {
    view.show(null);
    view.mark([]);
    $("legend").hidden = true;
    numbers();
  }
}

function numbers() {
  if (!view || !part || !part.found || mode() !== "numbers") return;
  const list = part.found.characteristics.filter((one) => one.measured || one.balloon === chosen);
  view.number(list.map((one) => ({ balloon: one.balloon, p: one.p_part_mm, axis: one.axis })), chosen);
  const one = part.found.characteristics.find((each) => each.balloon === chosen);
  view.choose(one ? one.faces : []);
}

async function legend(faces) {
  const { tile } = await import("/static/part.js");
  const states = new Set(faces.map((face) => face.state));
  $("legend").replaceChildren(...["seen", "partly", "unseen", "left_out"].filter((state) => states.has(state)).map((state) => {
    const item = el("li");
    const sample = tile(state);
    sample.setAttribute("aria-hidden", "true");
    const count = faces.filter((face) => face.state === state).length;
    item.append(sample, el("span", `${t(LEGEND_WORDS[state])}: ${count === 1 ? t("1 face") : t("{n} faces", { n: count })}`));
    return item;
  }), el("li", `✕ ${t("points that no view shows")}`));
  $("legend").hidden = false;
}

function choseFace(face) {
  if (!part || !part.found) return;
  const one = part.found.characteristics.find((each) => each.faces.includes(face));
  const label = part.found.faces.find((each) => each.face === face);
  if (one) choose(one.balloon, true);
  const about = label ? told(label.label) : `F${face}`;
  const shown = plan && plan.found && plan.found.faces.find((each) => each.face === face);
  const covered = shown ? ` · ${t("{p} in sight", { p: percent(shown.covered_fraction) })}` : "";
  $("scene-words").textContent = one ? `${about}: ${one.balloon}, ${told(one.id)}${covered}` : `${about}: ${t("no characteristic")}${covered}`;
}

function choose(balloon, scroll = false) {
  chosen = balloon;
  for (const row of $("rows").children) {
    const is = Number(row.dataset.balloon) === balloon;
    row.toggleAttribute("aria-current", is);
    if (is && scroll) row.scrollIntoView({ block: "nearest" });
  }
  numbers();
}

function cell(title, content) {
  const made = el("td");
  made.dataset.title = title;
  made.append(content);
  return made;
}

function field(one, name, value, label) {
  const input = el("input");
  input.value = value === null || value === undefined ? "" : plain(value);
  input.inputMode = "decimal";
  input.disabled = !mayChange;
  input.setAttribute("aria-label", `${label}, ${told(one.id)}`);
  input.dataset.field = name;
  input.addEventListener("input", () => edited(one));
  return input;
}

function drawTable() {
  const found = part && part.found;
  $("table").hidden = !found;
  $("no-rows").hidden = Boolean(found);
  if (!found) return;
  const able = new Map(((check && check.found) || { characteristics: [] }).characteristics.map((one) => [one.id, one]));
  $("rows").replaceChildren(...found.characteristics.map((one) => {
    const row = el("tr");
    row.dataset.balloon = String(one.balloon);
    row.dataset.id = one.id;
    const isOneSided = ONE_SIDED.includes(one.kind);
    const pick = el("button", String(one.balloon), "plain balloon");
    pick.type = "button";
    pick.setAttribute("aria-label", t("Show characteristic {n} on the part", { n: one.balloon }));
    pick.addEventListener("click", () => choose(one.balloon));
    const critical = el("input");
    critical.type = "checkbox";
    critical.checked = one.critical;
    critical.disabled = !mayChange;
    critical.dataset.field = "critical";
    critical.setAttribute("aria-label", `${t("Critical")}, ${told(one.id)}`);
    critical.addEventListener("input", () => edited(one));
    const why = el("input");
    why.value = ignored(one);
    why.maxLength = 200;
    why.disabled = !mayChange;
    why.dataset.field = "ignore";
    why.setAttribute("aria-label", `${t("Not measured, because")}, ${told(one.id)}`);
    why.addEventListener("input", () => edited(one));
    const name = el("span", told(one.id));
    name.title = one.id; // as the recipe file writes it
    const found_ = able.get(one.id);
    const verified = !found_ ? "–" : !found_.measured ? t("not measured")
      : `${found_.capable ? `✓ ${t("yes")}` : `✗ ${t("no")}`}, U ${number(1000 * found_.U_mm)} µm`;
    row.append(
      cell(t("No."), pick), cell(t("Characteristic"), name),
      cell(t("Nominal"), isOneSided ? "–" : field(one, "nominal", one.nominal_mm, t("Nominal"))),
      cell(t("Lower limit"), isOneSided ? "–" : field(one, "lower", one.lower, t("Lower limit"))),
      cell(t("Upper limit"), field(one, "upper", one.upper, t("Upper limit"))),
      cell(t("By"), told(one.source).replace("ISO ", "")), cell(t("Critical"), critical), cell(t("Not measured, because"), why),
      cell(t("Can be verified"), verified),
    );
    row.addEventListener("focusin", () => { if (chosen !== one.balloon) choose(one.balloon); });
    return row;
  }));
  marks();
}

const LEFT_OUT = "left out by the recipe: ";
const ignored = (one) => (one.exempt.startsWith(LEFT_OUT) ? one.exempt.slice(LEFT_OUT.length) : "");

function edited(one) {
  const row = [...$("rows").children].find((each) => each.dataset.id === one.id);
  const value = (field_) => row.querySelector(`[data-field=${field_}]`);
  const change = { id: one.id };
  let isWrong = false;
  const why = value("ignore").value.trim();
  if (why !== ignored(one)) {
    change.ignore = why || null;
    if (why && why.length < 4) isWrong = true;
  }
  if (!why) {
    const same = (input, old) => input === null || Number(Number(old).toFixed(6)) === parsed(input.value);
    const nominal = value("nominal");
    const lower = value("lower");
    const upper = value("upper");
    for (const input of [nominal, lower, upper]) {
      const isBad = input !== null && Number.isNaN(parsed(input.value));
      if (input) input.setAttribute("aria-invalid", String(isBad));
      if (isBad) isWrong = true;
    }
    if (!isWrong) {
      if (!same(nominal, one.nominal_mm)) change.nominal = parsed(nominal.value);
      if (!same(lower, one.lower) || !same(upper, one.upper)) {
        if (lower) change.lower = parsed(lower.value);
        change.upper = parsed(upper.value);
      }
    }
    if (value("critical").checked !== one.critical) change.critical = value("critical").checked;
  }
  value("ignore").setAttribute("aria-invalid", String(Boolean(why) && why.length < 4));
  if (isWrong) changes.set(one.id, null);
  else if (Object.keys(change).length > 1) changes.set(one.id, change);
  else changes.delete(one.id);
  marks();
}

function marks() {
  for (const row of $("rows").children) row.classList.toggle("changed", changes.has(row.dataset.id));
  const wrong = [...changes.values()].filter((one) => one === null).length;
  const count = changes.size + Object.keys(settings).length;
  if (!$("draft")) return;
  seen = "";
  $("save").disabled = true;
  $("diff").hidden = true;
  $("draft").disabled = !count || wrong > 0;
  $("undo").disabled = !count;
  $("changes").textContent = wrong === 1 ? t("1 entry is no number") : wrong ? t("{n} entries are no numbers", { n: wrong })
    : count === 1 ? t("1 change") : t("{n} changes", { n: count });
}

for (const input of document.querySelectorAll("[data-setting]")) {
  input.addEventListener("input", () => {
    const name_ = input.dataset.setting;
    const isText = input.tagName === "SELECT";
    const value = isText ? input.value : parsed(input.value);
    const isBad = !isText && Number.isNaN(value);
    input.setAttribute("aria-invalid", String(isBad));
    if (value === facts.recipe.inspection[name_] || isBad) delete settings[name_];
    else settings[name_] = value;
    input.closest("label").classList.toggle("changed", name_ in settings);
    marks();
  });
}

function allChanges() {
  return { sha256: facts.sha256, inspection: settings, characteristics: [...changes.values()] };
}

function forget() {
  changes.clear();
  for (const name_ of Object.keys(settings)) delete settings[name_];
  for (const label of document.querySelectorAll("label.changed")) label.classList.remove("changed");
}

if ($("draft")) {
  $("draft").addEventListener("click", async () => {
    const reply = await post("/recipes/draft", { of: key, changes: allChanges() });
    if (reply.error) {
      said("save-said", told(reply.error), true);
      return;
    }
    seen = reply.seen;
    $("diff").replaceChildren(...reply.diff.map((line, k) => {
      const kind = k < 2 ? "" : line.startsWith("+") ? "added" : line.startsWith("-") ? "removed" : "";
      return el("span", `${line}\n`, kind);
    }));
    $("diff").hidden = false;
    $("save").disabled = !reply.diff.length;
    said("save-said", reply.diff.length ? t("This would be written; look at it, then write the file.") : t("Nothing would change."));
    $("diff").focus();
  });
  $("save").addEventListener("click", async () => {
    $("save").disabled = true;
    const reply = await post("/recipes/save", { of: key, changes: allChanges(), seen });
    if (reply.error) {
      said("save-said", told(reply.error), true);
      return;
    }
    forget();
    said("save-said", t("The file was written. The part is compiled anew, so that you see what holds now."));
    $("diff").hidden = true;
    await load();
    start("part");
  });
  $("undo").addEventListener("click", () => {
    forget();
    drawTable();
    fillSettings();
    said("save-said", "");
  });
}

// From which stable pose the plan begins; another choice makes that plan.
function fillPoses() {
  const poses = part && part.found ? part.found.poses : [];
  const shown = plan && plan.found ? plan.found.pose : null;
  $("pose-choice").hidden = poses.length < 2;
  $("pose").replaceChildren(...[null, ...poses].map((pose) => {
    const option = el("option", pose === null ? t("all; the likeliest is shown") : t("Pose {n}: {p}", { n: pose.index, p: percent(pose.probability) }));
    option.value = pose === null ? "" : String(pose.index);
    option.selected = pose !== null && pose.index === shown;
    return option;
  }));
}

function drawPlan() {
  fillPoses();
  const found = plan && plan.found;
  if (!found || !found.steps.length) {
    const why = found ? told(found.error) : plan ? plan.work.messages.map((one) => told(one)).join(" ") || t(STATE_WORDS[plan.work.state]) : t("There is no plan yet.");
    $("plan-words").textContent = found || plan ? `✗ ${why}` : why;
    for (const id of ["film", "time", "why"]) $(id).replaceChildren();
    $("why-head").hidden = true;
  } else {
    $("plan-words").textContent = t("From stable pose {pose}: {n} steps, {s} s; {p} of the surface in sight (± {u}), {most} possible in this cell.", {
      pose: found.pose, n: found.steps.length, s: number(found.forecast_s), p: percent(found.covered_fraction),
      u: percent(found.covered_U, 2), most: percent(found.reachable_fraction),
    });
    const whole = found.steps.reduce((sum, step) => sum + step.seconds, 0);
    $("time").replaceChildren(...found.steps.map((step, k) => {
      const bar = el("span", "", `bar ${step.new_fraction ? "views" : ""}`);
      bar.style.width = `${100 * step.seconds / whole}%`;
      bar.title = `${k + 1}: ${told(step.label)}, ${number(step.seconds, 1)} s`;
      return bar;
    }));
    $("film").replaceChildren(...found.steps.map((step, k) => {
      const item = el("li");
      const figure = el("figure");
      for (const [file, words] of [[step.picture, t("step {n}, from near", { n: k + 1 })], [step.picture_outside, t("step {n}, from outside", { n: k + 1 })]]) {
        if (!file) continue;
        const image = el("img");
        image.loading = "lazy";
        image.width = 320;
        image.height = file === step.picture ? 256 : 320;
        image.src = `/recipes/picture/${at}/plan/${file}?made=${encodeURIComponent(plan.work.seconds)}`;
        image.alt = words;
        figure.append(image);
      }
      const caption = el("figcaption");
      caption.append(el("b", `${k + 1}. ${told(step.label)}`), el("span", `${number(step.seconds, 1)} s`));
      if (step.new_fraction !== undefined) {
        caption.append(el("span", t("shows {p}, {q} for the first time", { p: percent(step.seen_fraction), q: percent(step.new_fraction) })));
      }
      figure.append(caption);
      item.append(figure);
      return item;
    }));
    $("why-head").hidden = !found.unseen.length;
    $("why").replaceChildren(...found.unseen.map((piece) => {
      const item = el("li");
      const button = el("button", "", "plain");
      button.type = "button";
      button.append(el("b", `${told(piece.label)}: ${percent(piece.area_fraction, 2)}`), el("span", told(piece.reason)));
      if (piece.remedy) button.append(el("small", `${t("What would help")}: ${told(piece.remedy)}`));
      if (piece.not_inspected) button.append(el("small", `${t("The recipe leaves it out")}: ${piece.not_inspected}`));
      button.addEventListener("click", async () => {
        document.querySelector("[name=mode][value=coverage]").checked = true;
        await drawMode();
        if (view) {
          view.choose([piece.face]);
          view.mark(piece.points);
          $("scene").scrollIntoView({ block: "nearest" });
        }
      });
      item.append(button);
      return item;
    }));
  }
  $("time").hidden = !$("time").childElementCount;
  const rows = found ? found.certificates : [];
  const list = el("ul");
  list.append(...rows.map((one) => el("li", one.planned
    ? t("✓ pose {pose} ({p}): views {views}, regrasps {regrips}, {s} s, {q} in sight", {
      pose: one.pose, p: percent(one.probability), views: one.views, regrips: one.regrips, s: number(one.forecast_s), q: percent(one.covered_fraction),
    })
    : `✗ ${t("pose {pose} ({p})", { pose: one.pose, p: percent(one.probability) })}: ${told(one.reason)}`)));
  $("certificates").replaceChildren(...(rows.length ? [el("h3", t("Every stable pose")), list] : []));
  drawMode();
}

function drawCheck() {
  const found = check && check.found;
  $("check-words").textContent = found
    ? (found.ok ? `✓ ${t("The recipe can be run in its cell.")}` : `✗ ${t("The recipe cannot be run yet:")}`)
    : check ? `✗ ${check.work.messages.map((one) => told(one)).join(" ") || t(STATE_WORDS[check.work.state])}` : t("It was not checked yet.");
  $("problems").replaceChildren(...(found ? found.problems.map((text) => el("li", told(text))) : []));
}

async function start(kind, pose = null) {
  said("said", "");
  const reply = await post("/recipes/start", { of: key, kind, pose });
  if (reply.error) said("said", told(reply.error), true);
  else follow();
}

function follow() {
  watch(async (last) => {
    if (last && last.about === key) await load();
  });
}

for (const button of document.querySelectorAll("[data-work]")) {
  button.addEventListener("click", () => start(button.dataset.work));
}
$("pose").addEventListener("change", () => start("plan", $("pose").value === "" ? null : Number($("pose").value)));
for (const radio of document.querySelectorAll("[name=mode]")) radio.addEventListener("change", drawMode);
listenToCancel();
await load();
const { running } = await get("/recipes/work");
if (running) follow();
else if (!facts.known.part && !facts.problem && may.mayAct === "yes") start("part");

// Starts a run: which recipes, how many parts, which serial numbers. The server knows what may be named.
import { $, el, get, number, post, said, send, t } from "/static/shared.js";

let choices = null;
let isSending = false;
let list = null; // that was sent last, as the server has it

function option(value, text, isUsable = true) {
  const made = el("option", text);
  made.value = value;
  made.disabled = !isUsable;
  return made;
}

function row() {
  const box = el("div", "", "pair");
  const recipe = el("label", `${t("Recipe")} `);
  const list = el("select", "", "recipe");
  for (const one of choices.recipes) {
    const words = one.problem ? `${one.key}: ${t("cannot be used")}` : one.name === one.key ? one.name : `${one.name} (${one.key})`;
    list.append(option(one.key, words, !one.problem));
  }
  recipe.append(list);
  const count = el("label", `${t("Parts")} `);
  const many = el("input", "", "count");
  Object.assign(many, { type: "number", min: 1, max: 100000, required: true });
  count.append(many);
  const preset = () => {
    const found = choices.recipes.find((one) => one.key === list.value);
    many.value = found ? found.count : 1;
    devices();
  };
  list.addEventListener("change", preset);
  box.append(recipe, count);
  $("start-recipes").append(box);
  preset();
  fields();
}

function devices() {
  const cell = choices.cells.find((one) => one.key === $("start-cell").value);
  const first = document.querySelector("#start-recipes select");
  const recipe = first && choices.recipes.find((one) => one.key === first.value);
  const emulated = cell ? cell.emulated : recipe ? recipe.emulated : [];
  $("start-devices").textContent = emulated.length
    ? t("Emulated: {devices}", { devices: emulated.map((name) => said(name)).join(", ") }) : t("All devices are real: metal moves.");
}

// What the last run was of; the form begins with it.
let lastRun = null;

async function load() {
  choices = await get("/now/choices");
  if (!choices.recipes) return;
  $("start-recipes").replaceChildren();
  $("start-cell").replaceChildren(option("", t("that of the recipe")),
    ...choices.cells.map((one) => option(one.key, one.problem ? `${one.key}: ${t("cannot be used")}` : one.key, !one.problem)));
  const isThere = ({ recipe }) => choices.recipes.some((one) => one.key === recipe && !one.problem);
  const last = choices.last && choices.last.recipes.every(isThere)
    && (!choices.last.cell || choices.cells.some((one) => one.key === choices.last.cell && !one.problem)) ? choices.last : null;
  $("again").hidden = !last;
  $("start-other").open = !last;
  $("start-other").querySelector("summary").hidden = !last;
  $("start").classList.toggle("primary", !last);
  if (last) {
    fill(last);
    return;
  }
  row();
  const again = lastRun && choices.recipes.find((one) => one.name === lastRun.recipe && !one.problem);
  if (again) choose(document.querySelector("#start-recipes .pair"), again.key);
}

function choose(box, key, count = null) {
  const recipe = box.querySelector("select.recipe");
  recipe.value = key;
  recipe.dispatchEvent(new Event("change"));
  if (count !== null) box.querySelector(".count").value = count;
}

// Fills the form with a batch, and says on the button what it is.
function fill(batch) {
  $("start-cell").value = batch.cell;
  for (const one of batch.recipes) {
    row();
    choose($("start-recipes").lastElementChild, one.recipe, one.count);
  }
  $("start-lot").value = batch.lot;
  $("start-order").value = batch.order_number;
  $("start-serials-how").value = batch.serial_from ? "across" : batch.is_read ? "scan" : "";
  $("start-serial-from").value = batch.serial_from;
  $("start-temperature").value = batch.part_temperature_c ?? "";
  $("start-speed").value = batch.speed;
  fields();
  devices();
  const parts = [...document.querySelectorAll("#start-recipes .pair")].map((box) =>
    `${box.querySelector(".recipe").value} × ${box.querySelector(".count").value}`);
  $("again-words").textContent = [
    ...parts, batch.lot && t("lot {lot}", { lot: batch.lot }), batch.order_number && t("order {order}", { order: batch.order_number }),
    batch.serial_from ? t("serial numbers count on") : batch.is_read ? t("serial numbers are read") : "", $("start-devices").textContent,
  ].filter(Boolean).join(" · ");
}

// Shows the form while nobody has the cell, and what a run that was started here has printed.
export function showStart(now) {
  const box = $("start-box");
  const { started, unfinished } = now;
  lastRun = now.run;
  const isStarting = Boolean(started) && started.code === null;
  if (box) {
    const was = box.hidden;
    box.hidden = now.runs || isStarting;
    if (was && !box.hidden) load();
    $("acts-box").hidden = !box.hidden;
    $("unfinished-box").hidden = box.hidden || !unfinished;
  }
  const shows = Boolean(started) && (isStarting ? !now.status : started.code !== 0 && !now.runs);
  $("started-box").hidden = !shows;
  if (!shows) return;
  $("started-head").textContent = isStarting
    ? t("{who} starts {what}: checks and emulated cell take a while", { who: started.who, what: started.recipes })
    : t("{what} ended with code {code}", { what: started.recipes, code: started.code });
  const lines = started.lines.map((line) => said(line));
  $("started-bar").hidden = !isStarting;
  if ($("started-cancel")) $("started-cancel").hidden = !isStarting;
  begun = isStarting ? Date.parse(started.began) : null;
  since();
  $("started-lines").textContent = lines.join("\n");
}

// Says for how long a run has been prepared, every second.
let begun = null;
function since() {
  $("started-now").textContent = begun === null ? "" : t("for {s} s", { s: number(Math.max(0, (Date.now() - begun) / 1000)) });
}
setInterval(since, 1000);

async function cancel() {
  try {
    const reply = await post("/now/cancel", {});
    $("started-now").textContent = reply.error ? `✗ ${said(reply.error)}` : t("sent …");
  } catch {
    $("started-now").textContent = `✗ ${t("The order did not reach the page. Look at the cell before you repeat it.")}`;
  }
}

const isCounted = (how) => how === "counted" || how === "across";

// Shows the fields that belong to how parts get their numbers, and to a run with parts at all.
function fields() {
  const isDry = $("start-dry").checked;
  const how = isDry ? "" : $("start-serials-how").value;
  for (const box of document.querySelectorAll("[data-of-parts]")) box.hidden = isDry;
  for (const box of document.querySelectorAll("[data-serials]")) {
    box.hidden = !box.dataset.serials.split(" ").includes(how);
  }
  for (const box of document.querySelectorAll("#start-recipes .count")) {
    box.closest("label").hidden = isDry;
    box.disabled = isDry;
  }
  document.querySelectorAll("#start-recipes .pair").forEach((box, k) => { box.hidden = how === "file" || (isDry && k > 0); });
  for (const box of document.querySelectorAll("[data-not-listed]")) box.hidden = isDry || how === "file";
  $("start-serial-from").required = isCounted(how);
  $("start-serials").required = how === "listed";
  $("start-list").required = how === "file";
}

// Sends the list when it is chosen, so that a person sees what is in it before the start.
async function sendList() {
  const [file] = $("start-list").files;
  list = null;
  $("start-list-said").textContent = "";
  if (!file) return;
  $("start-list-said").textContent = t("sent …");
  try {
    const found = await send("/now/list", file);
    if (found.error) {
      $("start-list-said").textContent = `✗ ${said(found.error)}`;
      return;
    }
    list = found;
    const each = found.recipes.map(([key, count]) => `${key}: ${count}`).join(", ");
    $("start-list-said").textContent = `✓ ${found.parts === 1 ? t("1 part") : t("{n} parts", { n: found.parts })}: ${each}`;
  } catch {
    $("start-list-said").textContent = `✗ ${t("The list did not reach the page.")}`;
  }
}

async function start(event) {
  event.preventDefault();
  if (isSending) return;
  isSending = true;
  $("start-said").textContent = t("sent …");
  const how = $("start-serials-how").value;
  const isDry = $("start-dry").checked;
  const figure = (id) => ($(id).value === "" ? null : Number($(id).value));
  const recipes = [...document.querySelectorAll("#start-recipes .pair")].map((box) => ({
    recipe: box.querySelector(".recipe").value, count: Number(box.querySelector(".count").value),
  }));
  if (how === "file" && !list && !isDry) {
    $("start-said").textContent = `✗ ${t("Choose the list of parts first.")}`;
    isSending = false;
    return;
  }
  const ofCell = { cell: $("start-cell").value, speed: figure("start-speed") ?? 1 };
  const body = isDry ? { ...ofCell, recipes: [{ recipe: recipes[0].recipe }], is_dry: true } : {
    ...ofCell,
    recipes: how === "file" ? [] : recipes,
    parts_list: how === "file" ? list.key : "",
    lot: $("start-lot").value.trim(),
    order_number: $("start-order").value.trim(),
    serial_from: isCounted(how) ? $("start-serial-from").value.trim() : "",
    goes_on: how === "across",
    is_read: how === "scan",
    serials: how === "listed" ? $("start-serials").value.split("\n").map((one) => one.trim()).filter(Boolean) : [],
    part_temperature_c: figure("start-temperature"),
    are_trays_empty: $("start-trays").checked,
    is_part_removed: $("start-removed").checked,
  };
  try {
    const reply = await post("/now/start", body);
    $("start-said").textContent = reply.error ? `✗ ${said(reply.error)}` : "";
    if (!reply.error) {
      $("start-trays").checked = false;
      $("start-removed").checked = false;
    }
  } catch {
    $("start-said").textContent = `✗ ${t("The order did not reach the page. Look at the cell before you repeat it.")}`;
  } finally {
    isSending = false;
  }
}

// Starts the last run's recipe again: its first question is about the part that was left.
function startAgain(isRemoved) {
  $("start-removed").checked = isRemoved;
  $("start-form").requestSubmit();
}

if ($("start-form")) {
  $("unfinished-on").addEventListener("click", () => startAgain(false));
  $("unfinished-out").addEventListener("click", () => startAgain(true));
  $("again").addEventListener("click", () => startAgain(false));
  $("started-cancel").addEventListener("click", cancel);
  $("start-form").addEventListener("submit", start);
  $("start-more").addEventListener("click", row);
  $("start-cell").addEventListener("change", devices);
  $("start-serials-how").addEventListener("change", fields);
  $("start-dry").addEventListener("change", fields);
  $("start-list").addEventListener("change", sendList);
  fields();
}

// Starts a run: which recipes, how many parts, which serial numbers. The server knows what may be named.
import { $, el, get, post, send, t } from "/static/shared.js";
import { said } from "/static/said.js";

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
  const number = el("input", "", "count");
  Object.assign(number, { type: "number", min: 1, max: 100000, required: true });
  count.append(number);
  const fill = () => {
    const found = choices.recipes.find((one) => one.key === list.value);
    number.value = found ? found.count : 1;
    devices();
  };
  list.addEventListener("change", fill);
  box.append(recipe, count);
  $("start-recipes").append(box);
  fill();
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
  row();
  const again = lastRun && choices.recipes.find((one) => one.name === lastRun.recipe && !one.problem);
  if (!again) return;
  const recipe = document.querySelector("#start-recipes select.recipe");
  recipe.value = again.key;
  recipe.dispatchEvent(new Event("change"));
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
  $("started-lines").textContent = started.lines.map((line) => said(line)).join("\n");
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
  const number = (id) => ($(id).value === "" ? null : Number($(id).value));
  const recipes = [...document.querySelectorAll("#start-recipes .pair")].map((box) => ({
    recipe: box.querySelector(".recipe").value, count: Number(box.querySelector(".count").value),
  }));
  if (how === "file" && !list && !isDry) {
    $("start-said").textContent = `✗ ${t("Choose the list of parts first.")}`;
    isSending = false;
    return;
  }
  const ofCell = { cell: $("start-cell").value, speed: number("start-speed") ?? 1 };
  const body = isDry ? { ...ofCell, recipes: [{ recipe: recipes[0].recipe }], is_dry: true } : {
    ...ofCell,
    recipes: how === "file" ? [] : recipes,
    parts_list: how === "file" ? list.key : "",
    lot: $("start-lot").value.trim(),
    serial_from: isCounted(how) ? $("start-serial-from").value.trim() : "",
    goes_on: how === "across",
    is_read: how === "scan",
    serials: how === "listed" ? $("start-serials").value.split("\n").map((one) => one.trim()).filter(Boolean) : [],
    part_temperature_c: number("start-temperature"),
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
  $("start-form").addEventListener("submit", start);
  $("start-more").addEventListener("click", row);
  $("start-cell").addEventListener("change", devices);
  $("start-serials-how").addEventListener("change", fields);
  $("start-dry").addEventListener("change", fields);
  $("start-list").addEventListener("change", sendList);
  fields();
}

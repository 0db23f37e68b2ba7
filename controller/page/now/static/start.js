// Starts a run: which recipes, how many parts, which serial numbers. The server knows what may be named.
import { $, el, get, post, t } from "/static/shared.js";
import { said } from "./said.js";

let choices = null;
let isSending = false;

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
}

function devices() {
  const cell = choices.cells.find((one) => one.key === $("start-cell").value);
  const first = document.querySelector("#start-recipes select");
  const recipe = first && choices.recipes.find((one) => one.key === first.value);
  const emulated = cell ? cell.emulated : recipe ? recipe.emulated : [];
  $("start-devices").textContent = emulated.length
    ? t("Emulated: {devices}", { devices: emulated.map((name) => said(name)).join(", ") }) : t("All devices are real: metal moves.");
}

async function load() {
  choices = await get("/now/choices");
  if (!choices.recipes) return;
  $("start-recipes").replaceChildren();
  $("start-cell").replaceChildren(option("", t("that of the recipe")),
    ...choices.cells.map((one) => option(one.key, one.problem ? `${one.key}: ${t("cannot be used")}` : one.key, !one.problem)));
  row();
}

// Shows the form while nobody has the cell, and what a run that was started here has printed.
export function showStart(now) {
  const box = $("start-box");
  const { started } = now;
  const isStarting = Boolean(started) && started.code === null;
  if (box) {
    const was = box.hidden;
    box.hidden = now.runs || isStarting;
    if (was && !box.hidden) load();
    $("acts-box").hidden = !box.hidden;
  }
  const shows = Boolean(started) && (isStarting ? !now.status : started.code !== 0 && !now.runs);
  $("started-box").hidden = !shows;
  if (!shows) return;
  $("started-head").textContent = isStarting
    ? t("{who} starts {what}: checks and emulated cell take a while", { who: started.who, what: started.recipes })
    : t("{what} ended with code {code}", { what: started.recipes, code: started.code });
  $("started-lines").textContent = started.lines.join("\n");
}

const isCounted = (how) => how === "counted" || how === "across";

// Shows the field of the way in which parts get their numbers.
function numbering() {
  const how = $("start-serials-how").value;
  for (const box of document.querySelectorAll("[data-serials]")) {
    box.hidden = !box.dataset.serials.split(" ").includes(how);
  }
  $("start-serial-from").required = isCounted(how);
  $("start-serials").required = how === "listed";
}

async function start(event) {
  event.preventDefault();
  if (isSending) return;
  isSending = true;
  $("start-said").textContent = t("sent …");
  const how = $("start-serials-how").value;
  const number = (id) => ($(id).value === "" ? null : Number($(id).value));
  const recipes = [...document.querySelectorAll("#start-recipes .pair")].map((box) => ({
    recipe: box.querySelector(".recipe").value, count: Number(box.querySelector(".count").value),
  }));
  try {
    const reply = await post("/now/start", {
      recipes,
      cell: $("start-cell").value,
      lot: $("start-lot").value.trim(),
      serial_from: isCounted(how) ? $("start-serial-from").value.trim() : "",
      goes_on: how === "across",
      is_read: how === "scan",
      serials: how === "listed" ? $("start-serials").value.split("\n").map((one) => one.trim()).filter(Boolean) : [],
      part_temperature_c: number("start-temperature"),
      speed: number("start-speed") ?? 1,
      are_trays_empty: $("start-trays").checked,
      is_part_removed: $("start-removed").checked,
    });
    $("start-said").textContent = reply.error ? `✗ ${t(reply.error)}` : "";
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

if ($("start-form")) {
  $("start-form").addEventListener("submit", start);
  $("start-more").addEventListener("click", row);
  $("start-cell").addEventListener("change", devices);
  $("start-serials-how").addEventListener("change", numbering);
  numbering();
}

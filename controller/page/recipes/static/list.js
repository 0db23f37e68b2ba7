// Page "Recipes": the list, and a new recipe from a CAD file.
import { $, el, entries, get, number, post, said as told, send, t } from "/static/shared.js";
import { addressOf, drawn, listenToCancel, said, STATE_WORDS, watch } from "/static/recipes/working.js";

const MADE_WORDS = {
  part: "compiled", plan: "planned", check: "checked",
};

function row(one) {
  const item = el("li");
  const link = el("a", one.file);
  link.href = `/recipes/one/${addressOf(one.key)}`;
  item.append(link);
  if (one.problem) item.append(el("p", `✗ ${told(one.problem)}`, "wrong"));
  else item.append(el("p", t("{name}: part {part}, cell {cell}", one), "quiet"));
  const known = Object.entries(one.known).map(([kind, work]) => {
    const words = `${t(MADE_WORDS[kind])}: ${t(STATE_WORDS[work.state])}`;
    return work.is_old ? `${words} (${t("before the last change")})` : words;
  });
  if (known.length) item.append(el("p", known.join(" · "), "quiet"));
  return item;
}

async function list() {
  const { recipes } = await get("/recipes/list");
  for (const [id, isOwn] of [["own", true], ["shipped", false]]) {
    const rows = recipes.filter((one) => one.is_own === isOwn).map(row);
    $(id).replaceChildren(...(rows.length ? rows : [el("li", t("None yet. One is made below, of a CAD file; `cellctl init` makes a whole project."), "quiet")]));
  }
}

async function draw() {
  const { work, found, error } = await get("/recipes/part/sent/file");
  if (error) return;
  $("choice").hidden = false;
  $("sent").hidden = !found;
  $("take").disabled = work.state !== "done";
  if (!found) {
    const why = work.messages.map((one) => told(one)).join("\n") || t("the file could not be read");
    said("sent-said", work.state === "cancelled" ? t("cancelled") : why, true);
    return;
  }
  said("sent-said", t("The file was read. Look at size and unit, then name the recipe."));
  const facts = [
    [t("Size"), `${found.size_mm.map((v) => number(v, 1)).join(" × ")} mm`],
    [t("Unit"), /\.(3mf|ste?p)$/i.test($("file").files[0].name) ? t("{unit}, by the file", { unit: found.unit }) : t("{unit}, as chosen", { unit: found.unit })],
    [t("Faces"), number(found.faces.length)],
    [t("Stable poses"), number(found.poses.length)],
    [t("Characteristics"), number(found.characteristics.length)],
  ];
  $("sent-facts").replaceChildren(...entries(facts));
  $("warnings").replaceChildren(...found.warnings.map((text) => el("li", `⚠ ${told(text)}`)));
  if (!$("stem").value) $("stem").value = found.part.replace(/[^A-Za-z0-9_-]+/g, "_").replace(/^[^A-Za-z0-9]+/, "").slice(0, 60);
  const mesh = await get("/recipes/mesh/sent/file");
  try {
    const view = await drawn(mesh, () => {});
    view.rest(found.poses.length ? found.poses[0].R : null);
    $("scene-words").textContent = "";
  } catch (problem) {
    $("scene").hidden = true;
    $("scene-words").textContent = t("The part cannot be drawn in this browser: {why}", { why: told(problem.message) });
  }
}

if ($("file")) {
  listenToCancel();
  $("file").addEventListener("change", () => { $("send").disabled = !$("file").files.length; });
  $("send").addEventListener("click", async () => {
    const [file] = $("file").files;
    if (!file) return;
    said("sent-said", "");
    $("send").disabled = true;
    $("stage").textContent = t("sending");
    $("progress").hidden = false;
    $("stem").value = $("body").value = "";
    try {
      const reply = await send("/recipes/send", file);
      if (reply.error) {
        $("progress").hidden = true;
        said("sent-said", told(reply.error), true);
      } else watch(draw);
    } catch {
      $("progress").hidden = true;
      said("sent-said", t("The file did not arrive; is it too large?"), true);
    }
    $("send").disabled = false;
  });
  const choice = () => ({ unit: $("unit").value, body: $("body").value.trim() });
  for (const id of ["unit", "body"]) $(id).addEventListener("input", () => { $("take").disabled = true; });
  $("again").addEventListener("click", async () => {
    const reply = await post("/recipes/read-again", choice());
    if (reply.error) said("sent-said", told(reply.error), true);
    else watch(draw);
  });
  $("take").addEventListener("click", async () => {
    const reply = await post("/recipes/take", { ...choice(), name: $("stem").value });
    if (reply.error) said("sent-said", told(reply.error), true);
    else location.assign(`/recipes/one/${addressOf(reply.key)}`);
  });
}
list();

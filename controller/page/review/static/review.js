// The verdict of a person: sent once, then the page is fetched anew with what the journal has.
import { Coverage } from "/static/coverage.js";
import { $, get, post, said as told, t } from "/static/shared.js";

const form = $("decide");
const said = $("said");

for (const picture of form.querySelectorAll(".crop img")) {
  const say = async () => {
    const place = picture.parentElement.querySelector(".lost");
    const answer = await get(picture.getAttribute("src")).catch(() => ({}));
    place.textContent = answer.error || t("the picture cannot be shown");
    place.hidden = false;
    picture.hidden = true;
  };
  picture.addEventListener("error", say);
  if (picture.complete && picture.naturalWidth === 0 && picture.currentSrc) say();
}

// How much of the part was compared, on its faces, the part turned as a person likes.
async function cover() {
  const found = await get(`/review/coverage/${form.dataset.run}/${form.dataset.number}`).catch(() => ({ error: t("the picture cannot be shown") }));
  if (found.error) {
    $("coverage-words").textContent = told(found.error);
    return;
  }
  const coverage = new Coverage();
  await coverage.part(`${found.coverage.run} ${found.coverage.recipe}`, found.mesh);
  coverage.show(found.coverage);
  $("coverage-table").open = true;
}
cover();

const named = () => {
  const found = {};
  for (const chosen of form.querySelectorAll("input[type=radio]:checked")) {
    if (!chosen.value) continue;
    for (const number of chosen.closest("fieldset").dataset.findings.split(" ")) found[number] = chosen.value;
  }
  return found;
};

form.addEventListener("submit", async (event) => {
  event.preventDefault();
  const why = $("why");
  const button = event.submitter;
  if (!why || !button || !button.value) return;
  if (!why.value.trim()) {
    said.textContent = `✕ ${t("Write a reason first.")}`;
    why.focus();
    return;
  }
  const buttons = form.querySelectorAll("button");
  for (const one of buttons) one.disabled = true;
  const answer = await post("/review/decide", {
    run: form.dataset.run, number: Number(form.dataset.number), seen: Number(form.dataset.seen),
    verdict: button.value, why: why.value, findings: named(),
  }).catch(() => ({ error: t("The page does not answer; nothing is certain. Load it again.") }));
  if (answer.error) {
    said.textContent = `✕ ${t(answer.error)}`;
    for (const one of buttons) one.disabled = false;
    return;
  }
  said.textContent = `✓ ${t("Written into the journal.")}`;
  location.reload();
});

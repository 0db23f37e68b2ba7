// Work of child processes, as this screen shows it: started, watched, cancelled.
import { $, get, number, post, t } from "/static/shared.js";

const EVERY_MS = 1000;
const KIND_WORDS = {
  part: "compiling", plan: "planning", check: "checking",
};
let watching = false;

export function said(id, text, isWrong = false) {
  $(id).textContent = text ? `${isWrong ? "✗" : "✓"} ${text}` : "";
  $(id).classList.toggle("wrong", isWrong);
}

// Watches what is at work until it ends; then calls `ended` with it.
export async function watch(ended) {
  if (watching) return;
  watching = true;
  let last = null;
  for (;;) {
    let found = null;
    try {
      found = (await get("/recipes/work")).running;
    } catch { /* the page's server is away; tried again */
      await new Promise((go) => setTimeout(go, EVERY_MS));
      continue;
    }
    $("progress").hidden = !found;
    if (!found) break;
    last = found;
    const stage = found.stage ? `: ${found.stage}` : "";
    $("stage").textContent = `… ${t(KIND_WORDS[found.kind] || found.kind)} (${found.about})${stage}, ${number(found.seconds)} s`;
    await new Promise((go) => setTimeout(go, EVERY_MS));
  }
  watching = false;
  ended(last);
}

export function listenToCancel() {
  $("cancel").addEventListener("click", async () => {
    $("cancel").disabled = true;
    await post("/recipes/cancel", {});
    $("cancel").disabled = false;
  });
}

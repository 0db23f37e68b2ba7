// Work of child processes, as this screen shows it: started, watched, cancelled.
import { $, get, number, post, said as told, t } from "/static/shared.js";

const EVERY_MS = 1000;
const KIND_WORDS = {
  part: "compiling", plan: "planning", check: "checking",
};
// How work stands.
const STATE_WORDS = {
  done: "done", refused: "says no", cancelled: "cancelled", running: "at work",
};
export { STATE_WORDS };
let watching = false;

// Returns a recipe's key as addresses have it.
export const addressOf = (key) => {
  const [group, name] = key.split(/\/(.*)/s);
  return `${group}/${encodeURIComponent(name)}`;
};

// Draws a part in the canvas `scene` and returns its view; throws where it cannot be drawn.
export async function drawn(mesh, pick) {
  if (mesh.why || mesh.error) throw new Error(mesh.why || mesh.error);
  const { PartView } = await import("/static/part.js");
  const fresh = $("scene").cloneNode(); // a canvas keeps its context: another part gets its own
  fresh.hidden = false; // the part before may not have been drawn
  $("scene").replaceWith(fresh);
  return new PartView(fresh, mesh, pick);
}

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
    const stage = found.stage ? `: ${told(found.stage)}` : "";
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

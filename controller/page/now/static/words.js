// Words of states, lights and verdicts, for *Now* and the wall.
import { t } from "/static/shared.js";

const MODE_WORDS = {
  execute: "Execute", suspending: "Suspending", suspended: "Suspended", unsuspending: "Unsuspending",
  resetting: "Resetting", idle: "Idle", stopping: "Stopping", stopped: "Stopped", aborting: "Aborting",
  aborted: "Aborted", clearing: "Clearing", holding: "Holding", held: "Held", completing: "Completing",
  complete: "Complete", starting: "Starting",
};
const LIGHT_WORDS = {
  fault: "Fault: a person has to look at the cell", attention: "Attention: the cell stands, or will",
  question: "Question: the cell waits for an answer", working: "Working", resting: "Resting",
  off: "No run: nobody has the cell",
};
const VERDICT_WORDS = {
  pass: "PASS", fail: "FAIL", indeterminate: "INDETERMINATE", not_evaluated: "NOT EVALUATED",
};
export { LIGHT_WORDS, VERDICT_WORDS };

export function stateWords(state) {
  const [mode, ...stage] = (state || "").split("_");
  const name = t(MODE_WORDS[mode] || (state ? state : "No run yet"));
  return stage.length ? `${name}: ${t(stage.join("_"))}` : name;
}

// What the cell is in, in a word or two.
export function headline(now) {
  if (now.preparing) return t("Being prepared");
  if (now.unfinished) return t("Unfinished part");
  return now.run && !now.run.end && !now.runs ? t("Broken off") : stateWords(now.state);
}

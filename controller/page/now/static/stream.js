// The server's stream of what is known: watched for silence, begun anew where it is lost.
import { learn, t } from "/static/shared.js";

// What is older is lost: shown, but no longer taken for what is so (FRESH_WALL_S of live.py).
const LOST_MS = 3000;
const RETRY_MS = 12000; // a stream that was silent for so long is begun anew

// The server sends the pieces that have changed; those named `run.…` are of the run.
const pieces = {};

function joined({ words, ...changed }) {
  learn(words);
  Object.assign(pieces, changed);
  const now = {};
  const ofRun = {};
  for (const [name, piece] of Object.entries(pieces)) {
    if (name.startsWith("run.")) ofRun[name.slice(4)] = piece;
    else now[name] = piece;
  }
  now.run = now.run && { ...now.run, ...ofRun };
  return now;
}

// Follows the stream. `takes` has a function for each kind of message; `tell` is called again and again
// with whether the server is silent, how old what is shown is [ms], and words where that is lost.
export function follow(takes, tell) {
  let stream = null;
  let heard = Date.now(); // when the server was heard last
  let tried = heard;
  let isBroken = false; // the stream was interrupted, and nothing was heard since
  let age = 0; // how old what the server shows was when it was heard last

  const say = () => {
    const silent = Date.now() - heard;
    const isSilent = isBroken || silent > LOST_MS;
    const words = isSilent ? t("The connection to the page is lost. What is shown is old; it is tried again.")
      : age > LOST_MS ? t("The page hears nothing new from journal and cell. What is shown is old.") : "";
    tell({ isSilent, words, age: age + silent });
  };
  const listen = () => {
    if (stream) stream.close();
    stream = new EventSource("/now/events");
    const hear = (kind, take) => stream.addEventListener(kind, (event) => {
      heard = Date.now();
      isBroken = false;
      take(JSON.parse(event.data));
      say();
    });
    hear("beat", (found) => { age = 1000 * found.age_s; });
    hear("end", () => location.assign("/login"));
    for (const [kind, take] of Object.entries(takes)) hear(kind, kind === "now" ? (changed) => take(joined(changed)) : take);
    stream.onerror = async () => {
      isBroken = true;
      say();
      if (stream.readyState !== EventSource.CLOSED) return;
      // the stream was refused, not interrupted: nobody is logged in any more, or the page is full
      try {
        const who = await fetch("/session", { credentials: "same-origin" });
        if (who.status === 401) location.assign("/login");
      } catch { /* the server is away: tried again below */ }
    };
  };
  const retry = (patience) => {
    say();
    if (Math.min(Date.now() - heard, Date.now() - tried) <= patience) return;
    tried = Date.now();
    listen();
  };
  setInterval(() => retry(RETRY_MS), 500);
  document.addEventListener("visibilitychange", () => { if (!document.hidden) retry(LOST_MS); });
  listen();
}

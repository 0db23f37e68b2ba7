// The wall: what a person reads from three metres. It takes no orders.
import { $, el, number, t } from "/static/shared.js";
import { follow } from "./stream.js";
import { LIGHT_WORDS, VERDICT_WORDS, headline } from "./words.js";

const COUNTED = ["pass", "fail", "indeterminate"];
const CLASSES = { pass: "good", fail: "bad", indeterminate: "open" };
const SIGNS = { pass: "✓", fail: "✕", indeterminate: "?" };

// A verdict in one word: the wall has no room for the English one in brackets beside it.
const short = (verdict) => t(VERDICT_WORDS[verdict] || verdict).replace(/ \(.*\)$/, "");

function show(now) {
  const { status, run } = now;
  for (const lamp of document.querySelectorAll("[data-light]")) {
    lamp.classList.toggle("lit", lamp.dataset.light === now.light);
  }
  $("light").textContent = t(LIGHT_WORDS[now.light]);
  $("state-name").textContent = headline(now);
  document.title = `${headline(now)} · cellctl`;
  const done = run && run.parts.length ? run.parts.at(-1) : null;
  const verdict = done && done.verdict;
  $("verdict").textContent = verdict ? `${SIGNS[verdict] || "–"} ${short(verdict)}` : "–";
  $("verdict").className = `verdict ${CLASSES[verdict] || "none"}`;
  $("verdict-of").textContent = done ? [`${t("Part")} ${done.part}`, done.serial].filter(Boolean).join(" · ") : t("No part is done yet.");
  $("wall-counts").replaceChildren(...COUNTED.map((one) => {
    const box = el("div");
    box.append(el("dt", `${SIGNS[one]} ${short(one)}`, `verdict ${CLASSES[one]}`), el("dd", number((run && run.counts[one]) || 0)));
    return box;
  }));
  $("left").textContent = status && status.seconds_left !== null ? `${number(status.seconds_left)} s` : "–";
  $("count").textContent = run && run.part ? (run.count ? t("{k} of {n}", { k: run.part, n: run.count }) : String(run.part)) : "–";
}

function lose({ words }) {
  $("lost").hidden = !words;
  $("lost-words").textContent = words;
  document.querySelector("main").classList.toggle("old", Boolean(words));
}

follow({ now: show }, lose);

// What all screens share: texts in the language of the person, elements, numbers, orders, log-out.
// All text goes in as text, never as HTML.
const words = JSON.parse(document.getElementById("words").textContent);
const csrf = document.querySelector('meta[name="csrf"]').content;
export const language = document.documentElement.lang;

// Returns a text in the language of the person; `{name}` in it is filled in.
export const t = (text, values = {}) => {
  let found = words[text] || text;
  for (const [name, value] of Object.entries(values)) found = found.replace(`{${name}}`, () => String(value));
  return found;
};

// What the cell says, by its English; each answer brings the words of its texts.
const sentences = {};
export const learn = (found) => Object.assign(sentences, found);

// Returns a text of the cell in the language of the person; an unknown one stays as it is.
export const said = (text) => (Object.hasOwn(sentences, text) ? sentences[text] : t(text));
export const $ = (id) => document.getElementById(id);
export const el = (tag, text = "", kind = "") => {
  const made = document.createElement(tag);
  if (text !== "") made.textContent = text;
  if (kind) made.className = kind;
  return made;
};
// Entries of a `dl`: [name, value] each.
export const entries = (found) => found.map(([name, value]) => {
  const box = el("div");
  box.append(el("dt", name), el("dd", value));
  return box;
});
export const svg = (tag, attributes) => {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  return made;
};
export const number = (value, digits = 0) =>
  value.toLocaleString(language, { minimumFractionDigits: digits, maximumFractionDigits: digits });
export const time = (utc) => new Date(utc).toLocaleTimeString(language);

async function answered(reply) {
  if (reply.status === 401) location.assign("/login");
  const found = await reply.json();
  learn(found.words);
  return found;
}

// Fetches JSON.
export const get = async (path) => answered(await fetch(path, { credentials: "same-origin" }));

// Sends an act; returns what is answered, with `error` if it was refused.
export const post = async (path, body) => answered(await fetch(path, {
  method: "POST", credentials: "same-origin",
  headers: { "Content-Type": "application/json", "X-CSRF-Token": csrf },
  body: JSON.stringify(body),
}));

// Sends a file that a person has chosen.
export const send = async (path, file) => answered(await fetch(`${path}?name=${encodeURIComponent(file.name)}`, {
  method: "POST", credentials: "same-origin",
  headers: { "Content-Type": "application/octet-stream", "X-CSRF-Token": csrf },
  body: file,
}));

$("logout").addEventListener("click", async () => {
  await fetch("/logout", { method: "POST", credentials: "same-origin", headers: { "X-CSRF-Token": csrf } });
  location.assign("/login");
});

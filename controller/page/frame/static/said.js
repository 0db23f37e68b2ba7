// What the cell itself says, in the language of the person: as `teller` of frame/words.py has it,
// where it is written what a blank takes.
import { language, t } from "/static/shared.js";

const words = JSON.parse(document.getElementById("cell-words").textContent);
const NESTED_MAX_COUNT = 8;
const KNOWN = new Set(["feature", "said"]);
const CLAUSES = /(; )/;
const NAMES = /( and |, )/;
const LINES = /(^  - |\n(?:  - )?)/;
const SEPARATED = { items: CLAUSES, where: CLAUSES, faces: NAMES, things: NAMES, lines: LINES, more_lines: LINES };
const isFigure = (name) => /^[a-z]\d?$/.test(name);

function taken(name) {
  if (isFigure(name)) return "[-+]?(?:\\d+(?:\\.\\d+)?(?:e[-+]?\\d+)?|inf|nan)";
  return /^\w+_id\d?$/.test(name) ? "\\S+?" : ".+?";
}

const patterns = Object.entries(words).filter(([text]) => /\{\w+\}/.test(text)).map(([text, word]) => {
  const chunks = text.split(/\{(\w+)\}/);
  const own = chunks.filter((chunk, k) => k % 2 === 0 && chunk);
  const pattern = chunks.map((chunk, k) => (k % 2 ? `(?<${chunk}>${taken(chunk)})` : chunk.replace(/[.*+?^${}()|[\]\\/]/g, "\\$&"))).join("");
  return { own, length: own.join("").length, fits: new RegExp(`^${pattern}$`, "s"), word };
}).sort((a, b) => b.length - a.length);

function found({ own, fits }, text) {
  let at = 0;
  for (const chunk of own) { // spares nearly all patterns their expression
    at = text.indexOf(chunk, at);
    if (at < 0) return null;
    at += chunk.length;
  }
  return fits.exec(text);
}

// Returns several texts in words; empty where one of them is not known, but for lines.
function inPieces(text, separator, depth) {
  const pieces = text.split(separator);
  if (pieces.length === 1) return "";
  const each = pieces.map((piece) => said(piece, depth + 1));
  return separator !== LINES && pieces.some((piece, k) => k % 2 === 0 && piece === each[k]) ? "" : each.join("");
}

// Returns what stands in a blank in words; null where that blank cannot take it.
function inBlank(name, part, depth) {
  if (isFigure(name)) return language === "de" ? part.replace(/[.,]/g, (one) => (one === "." ? "," : ".")) : part;
  const whole = said(part, depth);
  if (KNOWN.has(name)) return whole === part ? null : whole;
  return (SEPARATED[name] && inPieces(part, SEPARATED[name], depth)) || whole;
}

// Returns a text of the cell in the language of the person; an unknown one stays as it is.
export function said(text, depth = 0) {
  if (Object.hasOwn(words, text)) return words[text];
  if (depth === NESTED_MAX_COUNT) return text;
  if (text.endsWith(".")) {
    const whole = said(text.slice(0, -1), depth + 1);
    if (whole !== text.slice(0, -1)) return `${whole}.`;
  }
  for (const pattern of patterns) {
    const match = found(pattern, text);
    if (!match) continue;
    const parts = {};
    for (const [name, part] of Object.entries(match.groups)) parts[name] = inBlank(name, part, depth + 1);
    if (!Object.values(parts).includes(null)) return pattern.word.replace(/\{(\w+)\}/g, (_, name) => parts[name]);
  }
  return inPieces(text, CLAUSES, depth) || t(text);
}

// What the cell itself says, in the language of the person: as `teller` of frame/words.py has it.
import { t } from "/static/shared.js";

const words = JSON.parse(document.getElementById("cell-words").textContent);
const NESTED_MAX_COUNT = 4;
const blanked = Object.entries(words).filter(([text]) => /\{\w+\}/.test(text)).map(([text, word]) => {
  const pattern = text.replace(/[.*+?^$()|[\]\\/]/g, "\\$&").replace(/\{(\w+)\}/g, "(?<$1>.+?)");
  return { fits: new RegExp(`^${pattern}$`, "s"), word, own: text.replace(/\{\w+\}/g, "").length };
}).sort((a, b) => b.own - a.own);

// Returns a text of the cell in the language of the person; an unknown one stays as it is.
export function said(text, depth = 0) {
  if (Object.hasOwn(words, text)) return words[text];
  if (depth === NESTED_MAX_COUNT) return text;
  if (text.endsWith(".")) {
    const whole = said(text.slice(0, -1), depth + 1);
    if (whole !== text.slice(0, -1)) return `${whole}.`;
  }
  for (const { fits, word } of blanked) {
    const found = fits.exec(text);
    if (found) return word.replace(/\{(\w+)\}/g, (_, name) => said(found.groups[name], depth + 1));
  }
  return t(text);
}

// What the views have compared of the part at hand so far: its faces in three dimensions, figures, a table.
import { $, el, number, said, t } from "/static/shared.js";

// Classes of the share of a face that was compared: up to it, state of the drawing.
const CLASSES = [[0, "plain"], [1 / 3, "little"], [2 / 3, "much"], [1, "most"]];
const LEGEND_WORDS = {
  plain: "not compared yet", little: "up to a third", much: "up to two thirds", most: "more than two thirds",
};
const stateOf = (share) => CLASSES.find(([most]) => share <= most + 1e-9)[1];
const sized = (count, area) => (count === 1 ? t("1 face, {area} mm²", { area: number(area) })
  : t("{n} faces, {area} mm²", { n: number(count), area: number(area) }));
const percent = (share) => `${number(100 * share)} %`;

export class Coverage {
  constructor() {
    this.found = null; // what was compared, as the server has it
    this.key = ""; // run and recipe that the mesh is of
    this.faces = [];
    this.view = null;
    this.chosen = null;
  }

  // Takes the mesh of the part; the drawing is made anew only where it is another part.
  async part(key, mesh) {
    this.key = key;
    this.faces = mesh.faces || [];
    if (this.view) this.view.end();
    this.view = null;
    this.chosen = null;
    try {
      if (!mesh.vertices) throw new Error(mesh.why || mesh.error);
      const { PartView } = await import("/static/part.js");
      const fresh = $("coverage").cloneNode(); // a canvas keeps its context: another part gets its own
      fresh.hidden = false;
      $("coverage").replaceWith(fresh);
      const view = new PartView(fresh, mesh, (face) => { this.chosen = face; this.draw(); });
      if (this.key === key) this.view = view;
      else view.end(); // another part came meanwhile
    } catch (error) {
      $("coverage").hidden = true;
      $("coverage-why").textContent = t("The part cannot be drawn in this browser: {why}", { why: said(error.message) });
    }
    if (this.view) $("coverage-why").textContent = "";
    this.draw();
  }

  show(found) {
    if (this.found && this.found.part !== found.part) this.chosen = null;
    this.found = found;
    this.draw();
  }

  draw() {
    const { found } = this;
    // the mesh of another recipe's part is still on its way
    if (!found || this.key !== `${found.run} ${found.recipe}`) return;
    const counts = new Map(found.faces.map(([face, count, of]) => [face, count / of]));
    const rows = this.faces.map((one) => ({ ...one, share: counts.get(one.face) || 0 }));
    const area = rows.reduce((sum, one) => sum + one.area_mm2, 0);
    const done = rows.reduce((sum, one) => sum + one.share * one.area_mm2, 0);
    const chosen = rows.find((one) => one.face === this.chosen);
    $("coverage-words").textContent = !found.part ? t("There is no part yet.")
      : [
        t("Part {part}: {p} of the surface compared", { part: found.part, p: area ? percent(done / area) : "–" }),
        found.views === 1 ? t("1 view judged.") : t("{n} views judged.", { n: number(found.views) }),
      ].join(", ");
    $("coverage-face").textContent = chosen
      ? t("{face}: {p} of {area} mm² compared", { face: said(chosen.label), p: percent(chosen.share), area: number(chosen.area_mm2) })
      : this.view ? t("Click a face to see its figures; arrow keys turn the part.") : "";
    if (this.view) {
      this.view.show(new Map(rows.map((one) => [one.face, stateOf(one.share)])));
      this.view.choose(chosen ? [chosen.face] : []);
    }
    this.legend(rows);
    $("coverage-rows").replaceChildren(...rows.map((one) => {
      const row = el("tr");
      const head = el("th", said(one.label));
      head.scope = "row";
      row.append(head, el("td", percent(one.share), "n"), el("td", number(one.area_mm2), "n"));
      return row;
    }));
    $("coverage-table").hidden = !rows.length;
  }

  async legend(rows) {
    let tile;
    try {
      ({ tile } = await import("/static/part.js"));
    } catch {
      return; // the server is lost, which the page says; what was drawn stays
    }
    $("coverage-legend").replaceChildren(...(rows.length ? CLASSES : []).map(([, state]) => {
      const those = rows.filter((one) => stateOf(one.share) === state);
      const sample = tile(state);
      sample.setAttribute("aria-hidden", "true");
      const item = el("li");
      const area = those.reduce((sum, one) => sum + one.area_mm2, 0);
      item.append(sample, el("span", `${t(LEGEND_WORDS[state])}: ${sized(those.length, area)}`));
      return item;
    }));
  }
}

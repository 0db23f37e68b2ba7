// Page "Cell": what is known of devices, calibrations and commissioning; pictures of the last run.
import { $, el, get, number, post, said, svg, t, time } from "/static/shared.js";

const PICTURES_EVERY_MS = 3000;
const DOCTOR_EVERY_MS = 1000;
const DEVICE_WORDS = {
  arm: "Arm", gripper: "Fixed gripper", lights: "Lamps", io: "Inputs and outputs",
  overhead: "Overhead camera", inspection: "Inspection camera",
};
const STEP_WORDS = {
  done: "done", stale: "stale", failed: "failed", "not done": "not done",
};
const CALIBRATION_WORDS = {
  overhead: "Overhead camera", inspection: "Inspection camera", arm: "Arm",
  fixed_gripper: "Fixed gripper", trays: "Trays", lamps: "Lamps", verification: "Verification",
};
const STAGE_WORDS = {
  devices: "Devices", light: "Light", arm: "Arm", grippers: "Grippers", trays: "Trays", reach: "Reach",
  verify: "Verification",
};
const LAMP_WORDS = {
  table_backlight: "table, backlight", table_ring: "table, ring light", table_side: "table, side light",
  station_backlight: "station, backlight", station_ring: "station, ring light", station_side: "station, side light",
};
// A check is named after a device, an input or a package.
const checkWords = (name) => (DEVICE_WORDS[name] ? t(DEVICE_WORDS[name]) : said(name));
const SIGNS = { done: "✓", stale: "⚠", failed: "✗", "not done": "○" };
let key = "";
let shown = "";

const row = (cells) => {
  const made = el("tr");
  for (const content of cells) {
    const cell = el("td");
    cell.append(content);
    made.append(cell);
  }
  return made;
};

// Returns a row of six columns that says why there is none.
function none(words) {
  const made = row([words]);
  made.firstChild.colSpan = 6;
  return made;
}

async function load() {
  const facts = await get(`/cell/facts?cell=${encodeURIComponent(key)}`);
  if (facts.error) {
    $("problem").hidden = false;
    $("problem").textContent = t(facts.error);
    return;
  }
  key = facts.key;
  $("cells").replaceChildren(...facts.cells.map((one) => {
    const option = el("option", one);
    option.value = one;
    option.selected = one === key;
    return option;
  }));
  $("problem").hidden = !facts.problem;
  $("problem").textContent = said(facts.problem);
  $("holder").textContent = facts.holder ? t("A run has the cell: {holder}", { holder: said(facts.holder) }) : t("No run has the cell.");
  if (facts.problem) return;
  $("name").textContent = `${t("Cell")} ${facts.name}`;
  $("connected").textContent = facts.journal ? said(facts.journal) : (facts.connected.run
    ? t("Answers of run {run}, {at}", { run: facts.connected.run, at: facts.connected.at.replace("T", " ").slice(0, 19) })
    : t("No run has connected to devices yet."));
  $("devices").replaceChildren(...facts.devices.map((one) => row([
    t(DEVICE_WORDS[one.name] || one.name), one.driver, one.address,
    one.is_emulated ? t("emulated") : t("real"),
    one.said ? `${said(one.said)}${one.was_emulated ? ` (${t("emulated then")})` : ""}` : "–",
  ])));
  $("verified").textContent = facts.why_not_verified
    ? `⚠ ${t("The cell is not verified: {why}", { why: said(facts.why_not_verified) })}` : `✓ ${t("The cell is verified with these calibrations.")}`;
  $("calibrations").replaceChildren(...(facts.calibrations.length ? facts.calibrations.map((one) => {
    const valid = one.valid_days === null ? "" : ` (${t("valid for {n} days", { n: one.valid_days })})`;
    const most = one.valid_runs === null ? "" : ` / ${number(one.valid_runs)}`;
    const left = one.residual;
    return row([
      t(CALIBRATION_WORDS[one.name] || one.name),
      one.why_stale ? `⚠ ${t("stale")}: ${said(one.why_stale)}` : `✓ ${t("yes")}`,
      `${t("{n} days", { n: number(one.age_days, one.age_days < 10 ? 1 : 0) })}${valid}`,
      `${number(one.run_count)}${most}`,
      left ? `${number(left.value, 3)} ${left.unit} (${t("at most {n}", { n: number(left.limit, 3) })})` : "–",
      one.by || "–",
    ]);
  }) : [none(t("none: the cell stands as its file says"))]));
  $("steps").replaceChildren(...facts.steps.map((one) => el("li", `${SIGNS[one.status]} ${t(STAGE_WORDS[one.step] || one.step)}: ${t(STEP_WORDS[one.status])}, ${said(one.reason)}`)));
  $("evidence").replaceChildren(...(facts.evidence.length ? facts.evidence.map((name) => {
    const item = el("li");
    const link = el("a", name);
    link.href = `/cell/evidence?cell=${encodeURIComponent(key)}&name=${encodeURIComponent(name)}`;
    item.append(link);
    return item;
  }) : [el("li", t("none"))]));
  drift(facts.drift);
}

function drift({ off_mm: off, max_mm: most }) {
  $("drift").toggleAttribute("hidden", off.length < 2);
  if (!off.length) {
    $("drift-words").textContent = t("No part has been shown in enough views yet.");
    return;
  }
  const last = off.slice(-5);
  const middle = [...last].sort((a, b) => a - b)[Math.floor(last.length / 2)];
  $("drift-words").textContent = `${middle > most ? "⚠" : "✓"} ${t("Between views of a part they disagreed by {mm} mm (middle of the last {n} of {all} parts); {most} mm are allowed for calibrated cells.", {
    mm: number(middle, 3), n: last.length, all: off.length, most: number(most, 2),
  })}`;
  const top = Math.max(...off, most) * 1.15;
  const x = (k) => 40 + 550 * k / Math.max(1, off.length - 1);
  const y = (v) => 145 - 130 * v / top;
  const line = svg("line", { x1: 40, x2: 590, y1: y(most), y2: y(most), class: "limit" });
  const trend = svg("polyline", { points: off.map((v, k) => `${x(k)},${y(v)}`).join(" "), class: "trend" });
  const label = svg("text", { x: 2, y: y(most) + 4 });
  label.textContent = number(most, 1);
  const zero = svg("text", { x: 2, y: 149 });
  zero.textContent = "0 mm";
  $("drift").replaceChildren(line, trend, label, zero);
}

async function pictures() {
  let found = null;
  try {
    found = await get("/cell/pictures");
  } catch { /* the server is away: tried again */
    return;
  }
  const text = JSON.stringify(found);
  if (text === shown) return;
  shown = text;
  $("pictures-words").textContent = found.problem ? said(found.problem) : (found.pictures.length ? t("Run {run}", { run: found.run }) : t("There is none yet."));
  $("pictures").replaceChildren(...found.pictures.map((one) => figureOf(
    one, `/cell/picture/${encodeURIComponent(found.run)}/${one.number}?at=${encodeURIComponent(one.at)}`,
  )));
}

// A picture with its histogram and figures.
function figureOf(one, source) {
  const figure = el("figure");
  const image = el("img");
  image.src = source;
  const name = `${t(DEVICE_WORDS[one.camera])}, ${t(LAMP_WORDS[one.lamp] || one.lamp)}${one.view ? `, ${one.view}` : ""}`;
  image.alt = name;
  const caption = el("figcaption");
  caption.append(el("b", name));
  if (one.at) caption.append(el("span", time(one.at)));
  const { measured } = one;
  if (!measured) { // nor can it be shown
    figure.append(caption);
    caption.append(el("span", t("its file cannot be read")));
    return figure;
  }
  figure.append(image, caption);
  const chart = svg("svg", { viewBox: "0 0 256 64", class: "histogram", role: "img", preserveAspectRatio: "none" });
  chart.setAttribute("aria-label", t("Histogram of grey levels, dark to bright"));
  const most = Math.max(...measured.histogram);
  measured.histogram.forEach((share, k) => {
    const high = 62 * Math.sqrt(share / most);
    chart.append(svg("rect", { x: 4 * k, y: 64 - high, width: 3.4, height: high }));
  });
  figure.append(chart);
  caption.append(el("span", t("focus {f}; mean level {m}; black {b}, white {w}", {
    f: number(measured.focus, 1), m: number(measured.mean), b: `${number(100 * measured.dark, 1)} %`, w: `${number(100 * measured.bright, 1)} %`,
  })));
  return figure;
}

// Follows the pictures that are being taken, until they end.
async function live() {
  if (!$("watch")) return;
  for (;;) {
    let found = null;
    try {
      found = await get("/cell/live");
    } catch {
      return;
    }
    const { work } = found;
    const isOn = Boolean(work) && work.state === "running";
    $("watch").disabled = $("examine").disabled = isOn;
    $("enough").disabled = !isOn;
    if (found.pictures.every((one) => one.measured)) {
      $("live").replaceChildren(...found.pictures.map((one) => figureOf(one, `/cell/live/${one.file}`)));
    }
    const bad = found.failed.map((one) => `${checkWords(one.check)}: ${said(one.found)}`);
    if (!work) $("live-said").textContent = "";
    else if (isOn) $("live-said").textContent = `… ${t("looking, {s} s", { s: number(work.seconds) })}`;
    else if (work.code === -9) $("live-said").textContent = `✗ ${t("It was ended by force; lamps may still be lit.")}`;
    else if (work.state === "refused") $("live-said").textContent = `✗ ${[...bad, ...work.messages.map((one) => said(one))].join(" ")}`;
    else $("live-said").textContent = `✓ ${t("The cameras are free again; the lamps are dark.")}`;
    if (!isOn) return;
    await new Promise((go) => setTimeout(go, DOCTOR_EVERY_MS));
  }
}

async function doctor() {
  for (;;) {
    let found = null;
    try {
      found = await get(`/cell/doctor?cell=${encodeURIComponent(key)}`);
    } catch {
      return;
    }
    if ($("examine")) {
      $("examine").disabled = Boolean(found.running);
      $("cancel").disabled = !found.running;
    }
    const { work } = found;
    $("checks").replaceChildren(...found.checks.map((one) => el("li", `${one.ok ? "✓" : "✗"} ${checkWords(one.check)}: ${said(one.found)}${one.ok ? "" : ` – ${said(one.remedy)}`}`)));
    if (!found.running) {
      const bad = found.checks.filter((one) => !one.ok).length;
      $("doctor-said").textContent = !work ? "" : work.state === "cancelled" ? `✗ ${t("cancelled")}`
        : !found.checks.length ? `✗ ${work.messages.map((one) => said(one)).join(" ")}`
          : bad ? `✗ ${bad === 1 ? t("1 check failed") : t("{n} checks failed", { n: bad })}` : `✓ ${t("all well")}`;
      return;
    }
    $("doctor-said").textContent = `… ${t("examining, {s} s", { s: number(found.running.seconds) })}`;
    await new Promise((go) => setTimeout(go, DOCTOR_EVERY_MS));
  }
}

$("cells").addEventListener("change", async () => {
  key = $("cells").value;
  await load();
  await doctor();
});
if ($("examine")) {
  $("examine").addEventListener("click", async () => {
    const reply = await post("/cell/examine", { cell: key });
    if (reply.error) $("doctor-said").textContent = `✗ ${said(reply.error)}`;
    else await doctor();
    await load();
  });
  $("cancel").addEventListener("click", () => post("/cell/cancel", {}));
  $("watch").addEventListener("click", async () => {
    const reply = await post("/cell/watch", { cell: key });
    if (reply.error) $("live-said").textContent = `✗ ${said(reply.error)}`;
    else await live();
  });
  $("enough").addEventListener("click", () => {
    $("enough").disabled = true;
    post("/cell/cancel", {});
  });
}
await load();
pictures();
setInterval(pictures, PICTURES_EVERY_MS);
await doctor();
await live();

"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const at = (id) => document.getElementById(id);
const FILE = 0, REPORT = 1, VEHICLE = 2, CREATED = 3, ORIGIN = 4, VERDICT = 5, CHI2 = 6, WHY = 7, VALUE = 8, STD = 9;
const COLOURS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7f7f7f"];
const PAGE = 100;
const name = (row) => row[FILE].split(/[\\/]/).pop();
const grouped = (text) => text.replace(/^-?\d+/, (whole) => whole.replace(/\B(?=(\d{3})+$)/g, ","));
const number = (x) => x === null ? "" : grouped(Number(x.toPrecision(5)).toString());
function measured(value, std) {
  if (value === null || !std) return number(value);
  const half = 1.96 * std, place = Math.floor(Math.log10(Number(half.toPrecision(2)))) - 1, digits = Math.max(0, -place), unit = 10 ** Math.max(0, place);
  return [value, half].map((x) => grouped((place > 0 ? Math.round(x / unit) * unit : x).toFixed(digits))).join(" ± ");
}

const vehicles = [...new Set(data.rows.map((row) => row[VEHICLE]))];
const colour = (vehicle) => COLOURS[Math.min(vehicles.indexOf(vehicle), COLOURS.length - 1)];
let chosen = [], sort = CREATED, down = false, first = 0;

function element(tag, text, kind) {
  const one = document.createElement(tag);
  one.textContent = text;
  if (kind) one.className = kind;
  return one;
}

function options(id, values, all) {
  at(id).replaceChildren(...(all ? [new Option(all, "")] : []), ...values.map(([v, text]) => new Option(text, v)));
}

function linked(row) {
  const cell = document.createElement("td");
  if (row[REPORT]) {
    const link = element("a", name(row));
    link.href = row[REPORT];
    cell.append(link);
  } else cell.textContent = name(row);
  cell.title = row[FILE];
  return cell;
}

function parameter() { return Number(at("parameter").value || 0); }

function choose() {
  const text = at("search").value.toLowerCase();
  const wanted = [[VEHICLE, at("vehicle").value], [VERDICT, at("verdict").value], [ORIGIN, at("origin").value]];
  chosen = data.rows.map((_, i) => i).filter((i) => {
    const row = data.rows[i];
    return wanted.every(([column, value]) => !value || row[column] === value)
      && (!text || row[FILE].toLowerCase().includes(text) || row[WHY].toLowerCase().includes(text));
  });
  const p = parameter(), key = (i) => sort === VALUE ? data.rows[i][VALUE][p] : data.rows[i][sort];
  chosen.sort((i, j) => {
    const a = key(i), b = key(j);
    if (a === null || b === null) return (a === null) - (b === null);
    return (a < b ? -1 : a > b ? 1 : i - j) * (down ? -1 : 1);
  });
  first = 0;
  show();
}

function show() {
  const p = parameter(), [symbol, unit] = data.parameters[p] || ["", ""];
  const heads = [["session", FILE], ["vehicle", VEHICLE], ["recorded", CREATED], ["data", ORIGIN], ["verdict", VERDICT], ["chi2/n", CHI2], [symbol + (unit ? ", " + unit : ""), VALUE], ["reasons", WHY]];
  at("columns").replaceChildren(...heads.map(([text, column]) => {
    const head = document.createElement("th"), button = element("button", text);
    head.scope = "col";
    if (column === sort) head.setAttribute("aria-sort", down ? "descending" : "ascending");
    button.type = "button";
    button.addEventListener("click", () => {
      down = column === sort && !down;
      sort = column;
      choose();
      at("columns").children[heads.findIndex((one) => one[1] === column)].firstChild.focus();
    });
    head.append(button);
    return head;
  }));
  at("rows").replaceChildren(...chosen.slice(first, first + PAGE).map((i) => {
    const row = data.rows[i], line = document.createElement("tr"), std = p in row[STD] ? row[STD][p] : null;
    const value = p in row[VALUE] ? row[VALUE][p] : null, bad = row[VERDICT] === "refused" && value !== null;
    line.append(linked(row), element("td", row[VEHICLE]), element("td", row[CREATED].slice(0, 16).replace("T", " "), "whole"),
      element("td", row[ORIGIN] === "real" ? "measured" : row[ORIGIN], "whole"));
    const verdict = document.createElement("td");
    verdict.append(element("span", (row[VERDICT] === "refused" ? "✕ " : "") + row[VERDICT], "word " + row[VERDICT]));
    line.append(verdict, element("td", number(row[CHI2]), "n"),
      element("td", (bad ? "✕ " : "") + measured(value, std), "n"), element("td", row[WHY], "why"));
    return line;
  }));
  const last = Math.min(first + PAGE, chosen.length);
  at("shown").textContent = chosen.length ? `${first + 1} to ${last} of ${chosen.length} sessions` : "No session is like that.";
  at("before").disabled = first === 0;
  at("after").disabled = last >= chosen.length;
  draw();
}

function median(values) {
  const sorted = [...values].sort((a, b) => a - b), half = sorted.length >> 1;
  return sorted.length % 2 ? sorted[half] : (sorted[half - 1] + sorted[half]) / 2;
}

function draw() {
  const p = parameter(), canvas = at("plot"), style = getComputedStyle(document.documentElement);
  const ink = style.getPropertyValue("--soft"), line = style.getPropertyValue("--line");
  const points = chosen.filter((i) => ["ok", "doubtful"].includes(data.rows[i][VERDICT]) && (data.rows[i][VALUE][p] ?? null) !== null);
  points.sort((i, j) => data.rows[i][CREATED] < data.rows[j][CREATED] ? -1 : data.rows[i][CREATED] > data.rows[j][CREATED] ? 1 : i - j);
  const times = points.map((i) => Date.parse(data.rows[i][CREATED]));
  const dated = times.length > 1 && times.every(Number.isFinite) && times[times.length - 1] > times[0];
  const x = points.map((_, k) => dated ? times[k] : k);
  const half = points.map((i) => 1.96 * (data.rows[i][STD][p] || 0));
  const y = points.map((i) => data.rows[i][VALUE][p]);
  const low = Math.min(...y.map((v, k) => v - half[k])), high = Math.max(...y.map((v, k) => v + half[k]));
  const [symbol, unit] = data.parameters[p] || ["", ""];
  const groups = new Map();
  points.forEach((i, k) => {
    const own = groups.get(data.rows[i][VEHICLE]) || [];
    own.push(k);
    groups.set(data.rows[i][VEHICLE], own);
  });
  const words = points.length ? `${symbol}${unit ? ", " + unit : ""} of ${number(points.length)} sessions, ${number(low)} to ${number(high)}, by ${dated ? "date" : "order"}` : "No session here has this parameter.";
  at("trend-words").textContent = words;
  canvas.setAttribute("aria-label", words);
  at("legend").replaceChildren(...[...groups].sort().map(([vehicle, own]) => {
    const item = document.createElement("li"), dot = document.createElement("span");
    dot.style.background = colour(vehicle);
    item.append(dot, `${vehicle || "no name"}: ${own.length}, median ${number(median(own.map((k) => y[k])))} ${unit}`);
    return item;
  }));
  const scale = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
  canvas.width = width * scale;
  canvas.height = height * scale;
  const pen = canvas.getContext("2d");
  pen.scale(scale, scale);
  pen.clearRect(0, 0, width, height);
  if (!points.length) return;
  const left = 64, right = width - 12, top = 10, bottom = height - 26;
  const room = (high - low) * 0.04 || Math.abs(high) * 0.01 || 1, y0 = low - room, y1 = high + room;
  const x0 = x[0], x1 = x[x.length - 1] > x0 ? x[x.length - 1] : x0 + 1;
  const X = (v) => left + 6 + (v - x0) / (x1 - x0) * (right - left - 12), Y = (v) => bottom - (v - y0) / (y1 - y0) * (bottom - top);
  pen.font = "12px system-ui, sans-serif";
  pen.fillStyle = ink;
  pen.strokeStyle = line;
  pen.textAlign = "right";
  const rough = (y1 - y0) / 5, ten = 10 ** Math.floor(Math.log10(rough));
  const step = ten * [1, 2, 5, 10].find((m) => m * ten >= rough);
  for (let k = Math.ceil(y0 / step); k * step <= y1; k++) {
    pen.beginPath(); pen.moveTo(left, Y(k * step)); pen.lineTo(right, Y(k * step)); pen.stroke();
    pen.fillText(number(k * step), left - 6, Y(k * step) + 4);
  }
  const label = (v, k) => dated ? new Date(v).toISOString().slice(0, x1 - x0 > 1.7e8 ? 10 : 16).replace("T", " ") : `${k + 1}`;
  pen.textAlign = "left"; pen.fillText(label(x[0], 0), left, height - 8);
  pen.textAlign = "right"; pen.fillText(label(x[x.length - 1], x.length - 1), right, height - 8);
  for (const [vehicle, own] of groups) {
    const middle = Y(median(own.map((k) => y[k])));
    pen.strokeStyle = pen.fillStyle = colour(vehicle);
    pen.globalAlpha = 0.7;
    pen.beginPath(); pen.moveTo(left, middle); pen.lineTo(right, middle); pen.stroke();
    for (const k of own) {
      pen.globalAlpha = own.length > 300 ? 0.25 : 0.6;
      pen.beginPath(); pen.moveTo(X(x[k]), Y(y[k] - half[k])); pen.lineTo(X(x[k]), Y(y[k] + half[k])); pen.stroke();
      pen.globalAlpha = own.length > 300 ? 0.6 : 1;
      pen.beginPath(); pen.arc(X(x[k]), Y(y[k]), points.length > 1000 ? 2 : 3.5, 0, 7); pen.fill();
    }
    pen.globalAlpha = 1;
  }
}

function begin() {
  const counts = {};
  for (const row of data.rows) counts[row[VERDICT]] = (counts[row[VERDICT]] || 0) + 1;
  at("summary").textContent = `${number(data.rows.length)} sessions: ` + Object.entries(counts).sort().map(([verdict, n]) => `${number(n)} ${verdict}`).join(", ");
  const distinct = (column) => [...new Set(data.rows.map((row) => row[column]))].filter(Boolean).sort().map((v) => [v, v === "real" ? "measured" : v]);
  options("vehicle", distinct(VEHICLE), "all");
  options("verdict", distinct(VERDICT), "all");
  options("origin", distinct(ORIGIN), "all");
  options("parameter", data.parameters.map(([symbol, unit], p) => [p, symbol + (unit ? ", " + unit : "")]));
  for (const id of ["vehicle", "verdict", "origin", "parameter"]) at(id).addEventListener("change", choose);
  at("search").addEventListener("input", choose);
  at("filters").addEventListener("submit", (event) => event.preventDefault());
  at("before").addEventListener("click", () => { first -= PAGE; show(); });
  at("after").addEventListener("click", () => { first += PAGE; show(); });
  window.addEventListener("resize", draw);
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  choose();
}

begin();

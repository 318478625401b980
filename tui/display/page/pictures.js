// The sketch of the bump and the progress of the campaign.

const SVG = "http://www.w3.org/2000/svg";
const WHEELS = [[48, 60], [152, 60], [48, 166], [152, 166]]; // front left, front right, rear left, rear right
const MOST_DOTS = 5;

function shape(name, attributes) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return made;
}

export function drawSketch(sketch, instruction) {
  const svg = document.getElementById("sketch");
  svg.toggleAttribute("hidden", !sketch);
  document.getElementById("legend").textContent = sketch ? sketch.legend : "";
  if (!sketch) return;
  svg.setAttribute("aria-label", `Car from above: ${instruction}`);
  const parts = [];
  WHEELS.forEach(([x, y], i) => {
    const lifted = sketch.wheels[i];
    parts.push(shape("rect", { class: lifted ? "wheel lifted" : "wheel", x: x - 10, y: y - 20, width: 20, height: 40, rx: 6 }));
    if (lifted && sketch.method === "roll_over") parts.push(shape("rect", { class: "board", x: x - 26, y: y - 37, width: 52, height: 10, rx: 3 }));
    if (lifted && sketch.method === "drop") parts.push(shape("rect", { class: "block", x: x - 20, y: y - 29, width: 40, height: 58, rx: 4 }));
  });
  document.getElementById("wheels").replaceChildren(...parts);
  const hand = document.getElementById("hand");
  hand.toggleAttribute("hidden", !sketch.hand);
  if (sketch.hand) hand.setAttribute("transform", `translate(${100 - 34 * sketch.hand[1]} ${113 - 62 * sketch.hand[0]})`);
}

function cell(name, text, className = "") {
  const made = document.createElement(name);
  made.textContent = text;
  made.className = className;
  return made;
}

// One line a kind of bump, one column a mass state.
export function drawProgress(view) {
  const states = [...new Set(view.rows.map((row) => row.mass_state))];
  const kinds = [...new Set(view.rows.map((row) => row.kind))];
  const rejected = view.rows.reduce((sum, row) => sum + row.rejected, 0);
  const title = view.planned ? `Campaign: ${view.done} of ${view.planned} runs` : "Campaign";
  document.getElementById("progress-title").textContent = rejected ? `${title}, ${rejected} rejected` : title;
  const head = document.createElement("tr");
  head.append(cell("td", ""), ...states.map((state) => {
    const made = cell("th", state[0].toUpperCase() + state.slice(1));
    made.scope = "col";
    return made;
  }));
  document.querySelector("#progress thead").replaceChildren(...(states.length ? [head] : []));
  document.querySelector("#progress tbody").replaceChildren(...kinds.map((kind) => {
    const line = document.createElement("tr");
    const name = cell("th", kind);
    name.scope = "row";
    line.append(name, ...states.map((state) => {
      const row = view.rows.find((one) => one.kind === kind && one.mass_state === state);
      return row ? count(row) : cell("td", "");
    }));
    return line;
  }));
}

function count(row) {
  const made = cell("td", "", row.due ? "due" : "");
  const total = Math.max(row.planned, row.accepted);
  if (total <= MOST_DOTS) {
    const dots = cell("i", "●".repeat(row.accepted) + "○".repeat(total - row.accepted));
    dots.ariaHidden = "true";
    made.append(dots);
  }
  made.append(`${row.accepted}/${row.planned}`);
  if (row.due) made.setAttribute("aria-current", "step");
  return made;
}

// The progress of the campaign.

const MOST_DOTS = 5;

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

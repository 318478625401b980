// Sets the word as wide as its place allows, in letters hardly taller than the font has them; where
// height is left over, a symbol stands above it.

const SVG = "http://www.w3.org/2000/svg";
const TALLEST = 1.25; // height of a letter over its width, compared with the font's own
const WIDEST = 1.2;
const REACH = 0.96; // of the place: round letters reach beyond the others
const SPACING = 4; // between letters, of a font of 100: drawn taller they would touch
const GAP = 0.07; // of the height, between two lines
const SYMBOLS = {
  wait: "M25 10h50M25 90h50M32 10v14q0 12 18 26q18-14 18-26V10M32 90V76q0-12 18-26q18 14 18 26v14",
  bump: "M50 8v58M24 44l26 26 26-26M14 90h72",
  "hands-off": "M50 8a42 42 0 1 0 .1 0zM21 21l58 58",
  accepted: "M12 54l26 28L88 20",
  done: "M12 54l26 28L88 20",
  again: "M84 50a34 34 0 1 1-10-24M76 6v22H54",
  ready: "M28 12l54 38-54 38z",
  paused: "M32 14v72M68 14v72",
  step: "M10 50h76M58 22l28 28-28 28",
  stopped: "M33 8h34l25 25v34l-25 25H33L8 67V33zM36 36l28 28M64 36l-28 28",
  lost: "M50 8L94 88H6zM50 38v24M50 76v1",
};

const measure = document.createElement("canvas").getContext("2d");

function sizes(lines, font) {
  measure.font = `900 100px ${font}`;
  return lines.map((text) => {
    const m = measure.measureText(text);
    return { text, left: m.actualBoundingBoxLeft, width: m.actualBoundingBoxLeft + m.actualBoundingBoxRight + SPACING * (text.length - 1),
             ascent: measure.measureText("H").actualBoundingBoxAscent };
  });
}

function layout(lines, font, width, wholeHeight) {
  const height = REACH * wholeHeight;
  const gap = GAP * height;
  const each = (height - gap * (lines.length - 1)) / lines.length;
  const found = sizes(lines, font);
  // All lines are of one height; each is as wide as it may be.
  const widths = found.map((line) => width / line.width);
  const tall = Math.min(each / found[0].ascent, TALLEST * Math.min(...widths));
  const placed = found.map((line, i) => {
    const wide = Math.min(widths[i], WIDEST * tall);
    return { ...line, tall, wide, high: line.ascent * tall };
  });
  return { placed, gap, used: placed.reduce((sum, line) => sum + line.high, gap * (lines.length - 1)),
           score: tall * Math.min(...placed.map((line) => line.wide)) };
}

export function drawWord(svg, words, kind) {
  const { width, height } = svg.getBoundingClientRect();
  if (!width || !height) return;
  svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
  const probe = svg.appendChild(document.createElementNS(SVG, "text"));
  const font = getComputedStyle(probe).fontFamily;
  const choices = words.length > 1 ? [words, [words.join(" ")]] : [words];
  const best = choices.map((lines) => layout(lines, font, width, height)).sort((a, b) => b.score - a.score)[0];
  const side = Math.min(height - best.used - 2 * best.gap, 0.6 * width);
  const withSymbol = side > 0.22 * height && SYMBOLS[kind];
  const left = height - best.used;
  let y = (left - (withSymbol ? side + best.gap : 0)) / 2;
  const parts = [];
  if (withSymbol) {
    const symbol = document.createElementNS(SVG, "path");
    symbol.setAttribute("class", "symbol");
    symbol.setAttribute("d", SYMBOLS[kind]);
    symbol.setAttribute("transform", `translate(${(width - side) / 2} ${y}) scale(${side / 100})`);
    parts.push(symbol);
    y += side + best.gap;
  }
  for (const line of best.placed) {
    const text = document.createElementNS(SVG, "text");
    text.textContent = line.text;
    text.setAttribute("letter-spacing", SPACING);
    y += line.high;
    const x = (width - line.width * line.wide) / 2 + line.left * line.wide;
    text.setAttribute("transform", `translate(${x} ${y}) scale(${line.wide} ${line.tall})`);
    parts.push(text);
    y += best.gap;
  }
  svg.replaceChildren(...parts);
  svg.dataset.high = best.used + (withSymbol ? side + best.gap : 0); // pixels that are drawn on
}

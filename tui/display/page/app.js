// Connects to the display's server, shows what it sends, and sends what the buttons order.

import { play, isAudible, isMuted, setMuted, unlock } from "./sound.js";
import { drawProgress } from "./progress.js";
import { drawWord } from "./word.js";
import { keepAwake, keepAwakeAfterTouch } from "./awake.js";

const SILENT_MS = 3000; // the server speaks at least once a second
const AGAIN_MS = 1500;
const ANSWER_MS = 5000;
const LOCK_OUT_MS = 300; // a bouncing finger
const $ = (id) => document.getElementById(id);

let view = null;
let cue = null;
let alarmCue = null;
let role = { control: false, granted: false };
let source = null;
let heard = performance.now();
let opened = -Infinity;
let lineLost = false;
let shown = "";

// Showing ------------------------------------------------------------------------------------

const NO_LINE = {
  kind: "lost", word: ["NO", "LINE"], why: "No news from the bench PC: is the Wi-Fi there?",
  advice: "This page tries again by itself. If the display was started anew, scan its code again.",
  digits: "", digits_are: "", share: null,
};

function text(id, value) {
  const place = $(id);
  if (place.textContent !== value) place.textContent = value;
}

function showHeadline(head) {
  document.body.dataset.kind = head.kind;
  const words = head.word.join(" ");
  const size = `${words} ${head.kind} ${innerWidth} ${innerHeight} ${$("word").clientWidth} ${$("word").clientHeight}`;
  text("state", words);
  document.title = `${words} · Bumpbench`;
  text("why", head.why);
  text("advice", head.advice);
  $("digits").hidden = !head.digits;
  $("digits").firstElementChild.textContent = head.digits;
  $("digits").lastElementChild.textContent = head.digits_are;
  $("decay").hidden = head.share === null;
  $("decay").firstElementChild.style.width = `${100 * (head.share ?? 0)}%`;
  $("decay").setAttribute("aria-valuenow", Math.round(100 * (head.share ?? 0)));
  if (size !== shown) {
    shown = size;
    drawWord($("word"), head.word, head.kind);
    const colour = getComputedStyle(document.body).getPropertyValue("--field").trim();
    document.querySelector('meta[name="theme-color"]').content = colour;
  }
  const now = `${words} ${head.kind} ${view?.title}`; // of each run anew
  if (now !== cue) {
    if (cue !== null) {
      play(head.kind);
      text("spoken", `${words}. ${head.why}`);
    }
    cue = now;
  }
}

function showAlarm(alarm, overload) {
  $("alarm").hidden = !alarm && !overload;
  if (alarm) {
    const more = alarm.more ? ` (and ${alarm.more} more)` : "";
    text("alarm-text", `⚠ ${alarm.text}${more}`);
    text("alarm-advice", alarm.advice);
  } else if (overload) {
    text("alarm-text", `⚠ OVERLOAD: ${overload}`);
    text("alarm-advice", "");
  }
  const now = alarm ? alarm.cue : "";
  if (now !== alarmCue) {
    if (now && alarmCue !== null) play("alarm");
    alarmCue = now;
  }
}

function show() {
  const head = lineLost || !view ? null : view.headline;
  document.body.classList.toggle("stale", lineLost || view?.headline.kind === "lost");
  if (view) {
    text("vehicle", view.vehicle || "Bumpbench");
    $("mark").hidden = !view.mark;
    text("mark", view.mark);
    text("title", view.title);
    text("instruction", view.instruction || "Nothing to bump now.");
    $("how").hidden = view.instruction === view.headline.why;
    document.body.classList.toggle("idle", !view.instruction);
    showAlarm(view.alarm, view.overload);
    drawIfChanged("rows", view.rows, () => drawProgress(view));
  }
  showButtons();
  if (lineLost) showHeadline(NO_LINE);
  else if (head) showHeadline(head);
}

const drawn = new Map();

function drawIfChanged(name, data, draw) {
  const now = JSON.stringify(data);
  if (drawn.get(name) === now) return;
  drawn.set(name, now);
  draw();
}

// The line -----------------------------------------------------------------------------------

function open() {
  source?.close();
  opened = performance.now();
  source = new EventSource("events");
  const on = (name, take) => source.addEventListener(name, (event) => {
    heard = performance.now();
    lineLost = false;
    take(event.data ? JSON.parse(event.data) : null);
    show();
  });
  on("role", (data) => { role = data; });
  on("view", (data) => { view = data; });
  on("beat", () => {});
}

function watchLine() {
  const now = performance.now();
  if (now - heard > SILENT_MS && !lineLost) {
    lineLost = true;
    show();
  }
  const dead = source.readyState === EventSource.CLOSED || now - heard > SILENT_MS;
  if (dead && now - opened > AGAIN_MS) open();
}

// Orders -------------------------------------------------------------------------------------

let answerTimer = 0;
let lastPress = -Infinity;

function answer(words) {
  clearTimeout(answerTimer);
  text("answer", words);
  if (words) answerTimer = setTimeout(() => text("answer", ""), ANSWER_MS);
}

function showButtons() {
  document.querySelector("footer").hidden = !role.control;
  $("buttons").hidden = !role.granted;
  $("grant").hidden = role.granted;
  const buttons = view && !lineLost ? view.buttons : { next: "", reject: "", pause: "" };
  for (const [name, usual] of [["next", "Start"], ["pause", "Pause"], ["reject", "Reject"]]) {
    $(name).disabled = !buttons[name];
    text(name, buttons[name] || usual);
  }
}

async function post(place, body) {
  const stop = AbortSignal.timeout(ANSWER_MS);
  try {
    const reply = await fetch(place, { method: "POST", headers: { "Content-Type": "application/json" },
                                       body: JSON.stringify(body), signal: stop });
    return { code: reply.status, error: (await reply.json()).error ?? "" };
  } catch {
    return { code: 0, error: "the bench PC did not answer" };
  }
}

async function press(button) {
  const now = performance.now();
  if (now - lastPress < LOCK_OUT_MS || !role.control) return;
  lastPress = now;
  if (!role.granted) { askNumber(); return; }
  if (!view || !view.buttons[button] || lineLost) return;
  answer("");
  const order = { button, target: view.buttons[`${button}_target`] ?? "" };
  const reply = await post("order", order);
  if (reply.code === 423) askTakeOver(order, reply.error);
  else if (reply.code === 403) { role.granted = false; show(); }
  else if (reply.error) answer(reply.error);
}

let onYes = async () => {};

function ask(title, withNumber, yes) {
  onYes = yes;
  text("ask-title", title);
  text("ask-error", "");
  $("number-label").hidden = !withNumber;
  $("number").value = "";
  $("ask").showModal();
  (withNumber ? $("number") : $("yes")).focus();
}

function askNumber() {
  ask("Type the six digits that the bench PC shows beside the link of this page (in its terminal: Ctrl+P, display). They keep others who have the link from starting runs.", true, async () => {
    const reply = await post("control", { number: $("number").value });
    if (reply.error) { text("ask-error", reply.error); return; }
    role.granted = true;
    $("ask").close();
    show();
  });
}

function askTakeOver(order, refusal) {
  ask(`${refusal}. Take control? The terminal takes it back with C.`, false, async () => {
    $("ask").close();
    const reply = await post("order", { ...order, take_over: true });
    if (reply.error) answer(reply.error);
  });
}

// Beginning ----------------------------------------------------------------------------------

async function touched() {
  await Promise.all([unlock(), keepAwakeAfterTouch()]);
  $("tap").hidden = isAudible();
}

function showSound() {
  $("sound").setAttribute("aria-pressed", String(!isMuted()));
  $("sound").setAttribute("aria-label", isMuted() ? "Sound is off" : "Sound is on");
}

function toggleSound() {
  setMuted(!isMuted());
  showSound();
}

function setDark(on) {
  document.body.classList.toggle("dark", on);
  $("dark").setAttribute("aria-pressed", String(on));
  try { localStorage.setItem("bumpbench-dark", on ? "yes" : "no"); } catch { /* not remembered */ }
  shown = "";
  show();
}

function fullScreen() {
  if (document.fullscreenElement) document.exitFullscreen();
  else document.documentElement.requestFullscreen?.().catch(() => {});
}

const KEYS = {
  " ": () => press("next"), PageDown: () => press("next"), Backspace: () => press("reject"), PageUp: () => press("reject"),
  Escape: () => press("pause"), p: () => press("pause"), m: toggleSound, d: () => $("dark").click(), f: fullScreen,
};

addEventListener("keydown", (event) => {
  touched();
  if ($("ask").open || event.ctrlKey || event.altKey || event.metaKey || event.repeat) return;
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  if (document.activeElement?.tagName === "BUTTON" && key === " ") return; // presses that button
  if (KEYS[key]) { event.preventDefault(); KEYS[key](); }
});
// After a touch SPACE is the next action again; who goes by Tab stays on the button.
const leave = (event) => { if (event.detail) event.currentTarget.blur(); };
addEventListener("pointerdown", touched);
addEventListener("resize", show);
document.addEventListener("visibilitychange", () => {
  if (document.visibilityState === "visible" && performance.now() - heard > SILENT_MS / 2) open();
});
for (const name of ["next", "reject", "pause"]) $(name).addEventListener("click", (event) => { leave(event); press(name); });
$("grant").addEventListener("click", askNumber);
$("no").addEventListener("click", () => $("ask").close());
$("ask").addEventListener("submit", (event) => { event.preventDefault(); onYes(); });
$("sound").addEventListener("click", (event) => { leave(event); toggleSound(); });
$("dark").addEventListener("click", (event) => { leave(event); setDark(!document.body.classList.contains("dark")); });
$("full").addEventListener("click", (event) => { leave(event); fullScreen(); });
$("full").hidden = !document.documentElement.requestFullscreen;
$("tap").hidden = false;
let dark = false;
try { dark = localStorage.getItem("bumpbench-dark") === "yes"; } catch { /* not remembered */ }
showSound();
keepAwake();
open();
setDark(dark);
setInterval(watchLine, 500);
new ResizeObserver(() => show()).observe($("word"));

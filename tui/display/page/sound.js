// Tones; browsers allow them only after the page was touched or a key was pressed.

const TONES = { // [frequency in Hz, start in s, length in s], and the wave
  bump: ["triangle", [[880, 0, 0.12], [1320, 0.15, 0.3]]],
  "hands-off": ["sine", [[520, 0, 0.08]]],
  accepted: ["sine", [[523, 0, 0.14], [659, 0.14, 0.14], [784, 0.28, 0.34]]],
  done: ["sine", [[523, 0, 0.14], [659, 0.14, 0.14], [784, 0.28, 0.14], [1047, 0.42, 0.5]]],
  again: ["sawtooth", [[233, 0, 0.22], [175, 0.26, 0.42]]],
  stopped: ["sawtooth", [[175, 0, 0.3], [175, 0.4, 0.3], [175, 0.8, 0.5]]],
  alarm: ["square", [[988, 0, 0.16], [740, 0.18, 0.16], [988, 0.36, 0.16], [740, 0.54, 0.16], [988, 0.72, 0.16]]],
  lost: ["triangle", [[660, 0, 0.3], [440, 0.32, 0.3], [294, 0.64, 0.6]]],
};
const LOUD = { sine: 0.5, triangle: 0.55, sawtooth: 0.25, square: 0.18 };
const KEY = "bumpbench-muted";

let audio = null;
let muted = false;
try { muted = localStorage.getItem(KEY) === "yes"; } catch { /* no storage: not remembered */ }

export const isMuted = () => muted;
export const isAudible = () => audio !== null && audio.state === "running";

export function setMuted(value) {
  muted = value;
  try { localStorage.setItem(KEY, value ? "yes" : "no"); } catch { /* as above */ }
}

export async function unlock() {
  audio ??= window.AudioContext ? new AudioContext() : null;
  if (audio && audio.state !== "running") await audio.resume().catch(() => {});
  return isAudible();
}

export function play(name) {
  const tones = TONES[name];
  if (muted || !tones || !isAudible()) return;
  const [wave, notes] = tones;
  for (const [hertz, start, length] of notes) {
    const at = audio.currentTime + 0.02 + start;
    const oscillator = new OscillatorNode(audio, { type: wave, frequency: hertz });
    const gain = new GainNode(audio, { gain: 0 });
    gain.gain.setValueAtTime(0, at);
    gain.gain.linearRampToValueAtTime(LOUD[wave], at + 0.015); // without a click
    gain.gain.setValueAtTime(LOUD[wave], at + length - 0.03);
    gain.gain.linearRampToValueAtTime(0, at + length);
    oscillator.connect(gain).connect(audio.destination);
    oscillator.start(at);
    oscillator.stop(at + length);
  }
}

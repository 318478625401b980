// Keeps the screen on.  Browsers have a wake lock on this machine and over HTTPS only; over plain
// HTTP a small silent film that plays does the same on most phones, once the page was touched.

let lock = null;
let film = null;

async function request() {
  if (!navigator.wakeLock || document.visibilityState !== "visible") return;
  try {
    lock = await navigator.wakeLock.request("screen");
    lock.addEventListener("release", () => { lock = null; });
  } catch { lock = null; } // low battery
}

export function keepAwake() {
  request();
  document.addEventListener("visibilitychange", () => { if (!lock) request(); });
}

export async function keepAwakeAfterTouch() {
  if (lock || film) return;
  if (navigator.wakeLock) { await request(); return; }
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 2;
  if (!canvas.captureStream) return;
  const paint = canvas.getContext("2d");
  film = document.createElement("video");
  film.className = "hidden";
  film.setAttribute("aria-hidden", "true");
  film.playsInline = true;
  const stream = canvas.captureStream(1);
  if (window.AudioContext) { // a film without sound does not keep every phone awake
    const audio = new AudioContext();
    const silence = audio.createMediaStreamDestination();
    new ConstantSourceNode(audio, { offset: 0 }).connect(silence);
    stream.addTrack(silence.stream.getAudioTracks()[0]);
  }
  film.srcObject = stream;
  document.body.append(film);
  setInterval(() => { paint.fillStyle = Date.now() % 2 ? "#000" : "#010101"; paint.fillRect(0, 0, 2, 2); }, 1000);
  await film.play().catch(() => {});
}

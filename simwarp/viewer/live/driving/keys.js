// Keys and gamepads of a page, told to the server while "Drive" is on. Runs as the body of a function.
const config = __CONFIG__;
const RATE = 1000 / 60; // between messages, at least [ms]
const BEAT = 100; // between messages while nothing changes [ms]: silence brakes
const DEAD = 0.08; // of sticks
const KEYS = {
  KeyW: "throttle", ArrowUp: "throttle", KeyS: "brake", ArrowDown: "brake", Space: "brake",
  KeyA: "left", ArrowLeft: "left", KeyD: "right", ArrowRight: "right", KeyQ: "clutch",
  KeyX: "gear_up", KeyZ: "gear_down", KeyR: "reset", KeyC: "camera",
};
// The standard gamepad: A resets, Y camera, left and right shoulder shift
const PAD = { 0: "reset", 3: "camera", 5: "gear_up", 4: "gear_down" };

if (window.simwarpDrive) window.simwarpDrive.stop();

const down = new Set();
let presses = [];
let padPressed = new Set();
let last = "";
let sent = 0;
let over = false;

const label = document.createElement("div");
label.id = "simwarp-drive";
label.style.cssText = "position:fixed;left:50%;bottom:14px;transform:translateX(-50%);z-index:1000;padding:6px 14px;" +
  "border-radius:16px;font:13px system-ui,sans-serif;background:rgba(20,24,32,.78);color:#fff;pointer-events:none;" +
  "max-width:90vw;box-sizing:border-box;text-align:center";
const tell = (text, bad) => {
  label.textContent = text;
  label.style.background = bad ? "rgba(176,32,32,.9)" : "rgba(20,24,32,.78)";
};
const HINT = "W A S D or arrows · Space brakes · " + (config.gears ? "Z X gears · " : "") + "R resets · C camera";
tell("connecting ...", false);
document.body.appendChild(label);

const scheme = location.protocol === "https:" ? "wss://" : "ws://";
const socket = new WebSocket(scheme + location.host + config.path);

const typing = () => {
  const field = document.activeElement;
  return !!field && (field.isContentEditable || field.tagName === "TEXTAREA" || field.tagName === "SELECT" ||
    (field.tagName === "INPUT" && !["checkbox", "radio", "range", "button"].includes(field.type)));
};

const onDown = (event) => {
  const what = KEYS[event.code];
  if (!what || typing() || event.ctrlKey || event.metaKey || event.altKey) return;
  event.stopImmediatePropagation();
  event.preventDefault();
  if (down.has(event.code)) return;
  down.add(event.code);
  if (["gear_up", "gear_down", "reset", "camera"].includes(what)) presses.push(what);
  tick();
};
const onUp = (event) => {
  if (!down.delete(event.code)) return;
  event.stopImmediatePropagation();
  event.preventDefault();
  tick();
};
const release = () => {
  down.clear();
  tick();
};
const onVisible = () => {
  if (document.hidden) release();
};

const stick = (value) => {
  const size = Math.abs(value || 0);
  return size <= DEAD ? 0 : Math.sign(value) * Math.min(1, (size - DEAD) / (1 - DEAD));
};

// Of the first gamepad: triggers are pedals, the left stick steers
const readPad = () => {
  const state = { steer: 0, throttle: 0, brake: 0 };
  const away = !document.hasFocus() || document.hidden;
  const pad = away ? null : [...(navigator.getGamepads ? navigator.getGamepads() : [])].find((each) => each);
  const pressed = new Set();
  if (pad) {
    const button = (index) => (pad.buttons[index] ? pad.buttons[index].value : 0);
    state.steer = -stick(pad.axes[0]);
    state.throttle = stick(button(7));
    state.brake = stick(button(6));
    for (const index of Object.keys(PAD)) {
      if (button(index) > 0.5) {
        pressed.add(index);
        if (!padPressed.has(index)) presses.push(PAD[index]);
      }
    }
  }
  padPressed = pressed;
  return state;
};

const held = (what) => ([...down].some((code) => KEYS[code] === what) ? 1 : 0);

const tick = () => {
  const now = performance.now();
  if (over || socket.readyState !== 1 || now - sent < RATE - 1) return;
  const state = readPad();
  state.steer = Math.max(-1, Math.min(1, state.steer + held("left") - held("right")));
  state.throttle = Math.max(state.throttle, held("throttle"));
  state.brake = Math.max(state.brake, held("brake"));
  state.clutch = held("clutch");
  for (const name of ["steer", "throttle", "brake"]) state[name] = Math.round(1000 * state[name]) / 1000;
  const text = JSON.stringify(state);
  if (text === last && !presses.length && now - sent < BEAT) return;
  socket.send(JSON.stringify({ ...state, presses }));
  presses = [];
  last = text;
  sent = now;
};

// Gamepads are read with every frame; the timer goes on where frames are slow
let frame = 0;
const onFrame = () => {
  tick();
  frame = requestAnimationFrame(onFrame);
};
const timer = setInterval(tick, RATE);
frame = requestAnimationFrame(onFrame);

const quiet = () => {
  over = true;
  clearInterval(timer);
  cancelAnimationFrame(frame);
  window.removeEventListener("keydown", onDown, true);
  window.removeEventListener("keyup", onUp, true);
  window.removeEventListener("blur", release);
  document.removeEventListener("visibilitychange", onVisible);
};
const stop = () => {
  quiet();
  label.remove();
  socket.close();
};

socket.onopen = () => tell(HINT, false);
socket.onclose = (event) => {
  quiet();
  if (!event.reason) return label.remove();
  tell(event.reason, true);
  setTimeout(() => label.remove(), 6000);
};
window.addEventListener("keydown", onDown, true);
window.addEventListener("keyup", onUp, true);
window.addEventListener("blur", release);
document.addEventListener("visibilitychange", onVisible);
if (document.activeElement && !typing()) document.activeElement.blur();
window.simwarpDrive = { stop, label };

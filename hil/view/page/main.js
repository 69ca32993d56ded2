// Puts connection, motion, picture and panels together.

import { Connection } from "./connection.js";
import { Controls, colourOf } from "./controls.js";
import { Headset } from "./xr.js";
import { Motion } from "./motion.js";
import { Stage } from "./stage.js";
import { Contacts, Strip } from "./strip.js";

const byId = (id) => document.getElementById(id);
const FROZEN_MS = 250, SLOW_FPS = 24, JUDGED_MS = 2500;

const notice = (text) => { const place = byId("notice"); place.textContent = text; place.hidden = !text; };
const linkShown = (kind, text) => { const place = byId("link"); place.className = `link ${kind}`; place.lastElementChild.textContent = text; };
const metres = (value) => (value === null || value === undefined ? "–" : value < 0.1 ? `${(1000 * value).toFixed(0)} mm` : `${(100 * value).toFixed(0)} cm`);
const median = (values) => [...values].sort((a, b) => a - b)[values.length >> 1];

let stage = null;
try {
  stage = new Stage(byId("stage"));
  stage.load().catch((error) => notice(`The avatar cannot be loaded: ${error.message}`));
} catch {
  notice("This browser has no WebGL: there is no picture, but figures and controls work.");
}

const headset = stage && new Headset(stage, byId("headset"), notice);
const motion = new Motion();
const strips = {
  palms: new Strip(byId("palms-strip"), { top: 80, colour: "#d65f1f" }),
  correction: new Strip(byId("correction-strip"), { top: 1, colour: "#1f6f9c" }),
};
const contacts = new Contacts(byId("contacts-strip"));
let state = {}, bars = [], trials = [], frozen = false, linked = "", shownContact = null;

const connection = new Connection({
  poses(poses) { motion.add(poses); arrivals.push(performance.now()); },
  text(text) { (heard[text.kind] || panel)(text); },
  link(kind) {
    if (kind === linked) return;
    linked = kind;
    if (kind === "lost") linkShown("bad", "connection lost, trying again");
    if (kind === "old") { linkShown("bad", "old page"); notice("This page is of another version of High Five: reload it."); }
  },
});
const controls = new Controls((name, value) => connection.command(name, value));
const arrivals = [];

const heard = {
  hello(text) {
    byId("title").textContent = text.title || "";
    controls.begin(text);
    byId("partners").hidden = !text.rig;
    notice("");
    if (text.webcam) openWebcam();
    motion.before = motion.newest = null;
    bars = [];
  },
  state(text) {
    state = text;
    controls.state(text);
    byId("palms").textContent = metres(text.palms_m);
    const left = text.time_to_contact_s;
    byId("contact").textContent = left === null || left === undefined || left > 1.5 || left < -0.3 ? "–" : left <= 0 ? "now" : `${left.toFixed(2)} s`;
    byId("markers").parentElement.hidden = !text.markers;
    byId("markers").textContent = text.markers ? `${text.tracked} of ${text.markers}` : "–";
    if (text.correction !== undefined) {  // not while it is paused
      strips.palms.add(text.time_s, text.palms_m === null ? null : 100 * text.palms_m);
      strips.correction.add(text.time_s, text.correction);
    }
    strips.palms.draw();
    strips.correction.draw();
    if (stage) stage.showForecast(text.forecast);
    if (text.message !== undefined) notice(text.message);
  },
  contacts(text) {
    trials = text.trials;
    controls.trials(trials);
  },
  contact(text) {
    bars.push({ distance: text.distance_m, met: text.met, colour: colourOf(text.style.split(" ")[0]) });
    contacts.set(bars);
  },
  camera({ granted }) { webcam?.granted(granted); },
  say(text) { spoken(text.message); },
  over(text) { notice(text.message); linkShown("", "over"); linked = "over"; connection.close(); },
  touch(text) {
    if (stage) stage.contact(text.where, performance.now());
    headset?.touch();
  },
};

/** What is said to who stands before the camera, large. */
function spoken(message) { const place = byId("spoken"); place.textContent = message; place.hidden = !message; }

let webcam = null;
/** The camera's panel, and her view of the avatar. */
async function openWebcam() {
  if (webcam) { webcam.claim(); return; }
  const { Webcam } = await import("./webcam.js");
  const panel = document.createElement("section");
  byId("panels").append(panel);
  webcam = new Webcam(connection, panel, { processor: !stage || stage.plain.coarse });
  window.highfive.webcam = webcam;
  const button = Object.assign(document.createElement("button"), { textContent: "Mirror", onclick: () => choose(button) });
  button.dataset.view = "mirror";
  byId("views").prepend(button);
  choose(button);
  webcam.claim();
}

/** Panels of other rooms: a text of a kind that none of ours has goes to who asked for it. */
const listeners = new Map();
function panel(text) { for (const hear of listeners.get(text.kind) || []) hear(text); }
export function addPanel(element, kind, hear) {
  byId("panels").append(element);
  listeners.set(kind, [...(listeners.get(kind) || []), hear]);
}

function choose(button) {
  if (stage) stage.view(button.dataset.view);
  for (const other of byId("views").children) other.setAttribute("aria-pressed", String(other === button));
}
for (const button of byId("views").children) button.onclick = () => choose(button);

for (const button of byId("partners").children) {
  button.onclick = () => {
    if (stage && stage.ready) stage.partner(button.dataset.partner);
    for (const other of byId("partners").children) other.setAttribute("aria-pressed", String(other === button));
  };
}

/** In a recording the palms meet when its time passes the contact's. */
function passContact(time) {
  const trial = trials[state.trial];
  if (!trial || trial.contact_s === null || !trial.where) { shownContact = null; return; }
  const past = time >= trial.contact_s;
  if (past && shownContact === false && time - trial.contact_s < 0.3) {
    if (stage) stage.contact(trial.where, performance.now());
    headset?.touch();
    const bar = { distance: trial.distance_m, met: trial.met, colour: colourOf(trial.style.split(" ")[0]) };
    bars.push(bar);
    contacts.set(bars);
  }
  shownContact = past;
}

const drawn = { frames: 0, since: performance.now(), ages: [], frame: 16, before: 0 };
function frame(now, seen) {
  drawn.frame += 0.1 * (Math.min(now - drawn.before, 50) - drawn.frame);
  drawn.before = now;
  // When this picture is on the screen: a headset says so.
  const time = connection.host(seen ? seen.predictedDisplayTime ?? now + drawn.frame : now + drawn.frame);
  const shown = motion.at(time);
  if (shown && stage) {
    stage.pose(shown.bodies);
    stage.showMarkers(motion.newest.markers, motion.newest.seen);
    if (motion.newest.captured) drawn.ages.push(time - motion.newest.captured);
    if (drawn.ages.length > 600) drawn.ages.shift();
    passContact(motion.newest.time);
  }
  const stale = shown && connection.synchronised && shown.age > FROZEN_MS;
  if (stale !== frozen && linked === "good") linkShown(stale ? "" : "good", stale ? "no new poses" : "live");
  if (linked === "good" && byId("link").classList.contains("bad")) linkShown("good", "live");
  frozen = stale;
  if (seen && headset) headset.frame(seen);
  if (stage && stage.ready) stage.draw(now);
  drawn.frames += 1;
}
if (stage) {
  stage.renderer.setAnimationLoop(frame);
} else {
  const again = (now) => { requestAnimationFrame(again); frame(now); };
  requestAnimationFrame(again);
}

setInterval(() => {
  const now = performance.now();
  while (arrivals.length && arrivals[0] < now - 1000) arrivals.shift();
  byId("rate").textContent = `${arrivals.length} Hz`;
  byId("latency").parentElement.hidden = !drawn.ages.length;
  byId("latency").textContent = drawn.ages.length ? `${median(drawn.ages).toFixed(0)} ms` : "–";
}, 500);

let judged = false;
setInterval(() => {
  const now = performance.now(), rate = (1000 * drawn.frames) / (now - drawn.since);
  window.highfive.fps = rate;
  // The first stretch is compiling and uploading; a hidden tab draws nothing and says nothing of the machine.
  if (stage && stage.ready && judged && !document.hidden && !headset.session && rate < SLOW_FPS) stage.simplify();
  judged = Boolean(stage && stage.ready);
  Object.assign(drawn, { frames: 0, since: now });
}, JUDGED_MS);

/** For benches and tests. */
window.highfive = { connection, motion, stage, headset, counts: connection.counts, ages: drawn.ages, fps: 0, state: () => state, frozen: () => frozen };

// Puts connection, motion, picture and panels together.

import { Connection } from "./connection.js";
import { Caption } from "./caption.js";
import { Controls } from "./controls.js";
import { Headset } from "./xr.js";
import { keepClear } from "./layout.js";
import { mirrored, mirroredForecast, mirroredPoint } from "./mirror.js";
import { colourOf } from "./moods.js";
import { Motion } from "./motion.js";
import { Stage } from "./stage.js";
import { Streams } from "./streams.js";
import { Contacts, Strip } from "./strip.js";

const byId = (id) => document.getElementById(id);
const BROKEN = {  // at the top right, and across the picture
  lost: ["connection lost", "The connection is lost; this page tries again by itself."],
  refused: ["not let in", "The key in this address is of another run: open the address that High Five printed."],
  full: ["full", "Too many pages look on already: close one."],
  old: ["old page", "This page is of another version of High Five: reload it."],
};
const CUT = "This recording has no end: it was cut short.";
const FROZEN_MS = 250, FRESH_MS = 600, JUDGED_MS = 2500, CHARTS_MS = 100, TOLD_MS = 250, MOST_TOLD = 128;

const NO_ENTRANCE = "This browser has no WebGL: no headset can be entered here, and there is no picture; figures and controls work.";
const PAUSED = "Paused.", STALE = "No new poses come: what you see stands still.";

/* What is amiss, each for as long as it holds: of those that hold the first is read across the picture. */
const notices = { over: "", link: "", why: "", headset: "", failed: "", enter: "", cut: "", lacking: "" };
function notice(kind, text) {
  notices[kind] = text || "";
  const place = byId("notice"), told = Object.values(notices).find(Boolean) || "";
  place.textContent = told;
  place.hidden = !told;
}
const linkShown = (kind, text) => { const place = byId("link"); place.className = `link ${kind}`; place.lastElementChild.textContent = text; };
const metres = (value) => (value === null || value === undefined ? "–" : value < 0.1 ? `${(1000 * value).toFixed(0)} mm` : `${(100 * value).toFixed(0)} cm`);
const median = (values) => [...values].sort((a, b) => a - b)[values.length >> 1];

let stage = null;
try {
  stage = new Stage(byId("stage"), byId("behind"));
  stage.load().catch((error) => notice("lacking", `The avatar cannot be loaded: ${error.message}`));
} catch {
  notice("lacking", "This browser has no WebGL: there is no picture, but figures and controls work.");
}
byId("help").onclick = () => { byId("helped").hidden = !byId("helped").hidden; };

/** What this browser lacks; and before a headset is worn that tracks her, how to enter. */
let hello = {};
function entrance() {
  const lacking = headset ? headset.lacking : "";
  byId("able").textContent = [
    stage ? (stage.fine ? "" : "Drawn by the processor: no graphics card, or the browser does not use it.") : "No WebGL: no picture.",
    lacking,
  ].filter(Boolean).join(" ");
  if (headset?.session) notice("failed", "");
  if (hello.tracks && !stage) notice("enter", NO_ENTRANCE);
  if (!hello.tracks || !headset || lacking === null || linked === "over") return;
  const beside = Boolean(hello.space?.rotation);  // a page on the desk is no mistake there
  notice("enter", headset.session ? "" : lacking ? (beside ? "" : lacking) : `Put the headset on, and press ${headset.modes.join(" or ")} here.`);
}
const headset = stage && new Headset(stage, byId("headset"), (text) => notice("failed", text), entrance);
const motion = new Motion();
const strips = {
  palms: new Strip(byId("palms-strip"), { top: 110, colour: "#d65f1f" }),
  correction: new Strip(byId("correction-strip"), { top: 1, colour: "#1f6f9c" }),
};
const contacts = new Contacts(byId("contacts-strip"));
let state = {}, bars = [], trials = [], frozen = false, behind = false, linked = "", said = "", why = "", refused = "", ended = "", arrived = 0, judgedAt = -Infinity, shownContact = null;

/** The picture, whole, is turned round for who gives a webcam the left hand; its left is then the window's right. */
let flipped = false, free = null;
const clear = () => { if (stage && free) stage.keepClear(flipped ? { ...free, left: free.right, right: free.left } : free); };

const connection = new Connection({
  poses(poses) { motion.add(behind && stage?.ready ? mirrored(poses, stage.names) : poses); arrivals.push(arrived = performance.now()); },
  text(text) { (heard[text.kind] || panel)(text); },
  link(kind) {
    if (kind === linked) return;
    linked = kind;
    controls.stop.link(kind === "good");
    if (BROKEN[kind]) linkShown("bad", BROKEN[kind][0]);
    notice("link", BROKEN[kind]?.[1]);
  },
});
const controls = new Controls((name, value) => connection.command(name, value));
const caption = new Caption(byId("mood"), byId("about"));
const arrivals = [];

const heard = {
  hello(text) {
    byId("title").textContent = text.title || "";
    controls.begin(text);
    caption.begin(text);
    document.body.classList.toggle("steered", text.mode !== "recording");
    byId("partners").hidden = !text.rig;
    const gone = text.lacking || [];
    notice("cut", [text.cut && CUT, gone.length && `Left out, for parts of it were not recorded: high five ${gone.join(", ")}.`].filter(Boolean).join(" "));
    notice("why", why = "");
    notice("headset", refused = "");
    hello = text;
    entrance();
    behind = Boolean(text.tracks || text.mode === "recording") && text.hand === "left";
    flipped = Boolean(text.webcam) && text.hand === "left";
    document.body.classList.toggle("flipped", flipped);
    if (headset) headset.space = text.space || null;
    clear();
    headset?.track(text.tracks ? (bytes) => connection.sendNewest(bytes) : null, (ms) => connection.host(ms), () => connection.send({ kind: "headset", over: true }));
    if (text.webcam) openWebcam();
    if (text.mode === "experiment") openExperiment();
    motion.clear();
    drawn.captured = 0;
    bars = [];
  },
  state(text) {
    state = text;
    controls.state(text);
    caption.state({ ...text, number: trials[text.trial]?.number, last: trials.at(-1)?.number });
    if (text.correction !== undefined) figures(text);  // while it is paused they stay
    if (stage) stage.showForecast(behind ? mirroredForecast(text.forecast) : text.forecast);
    if (text.message !== undefined) notice("why", why = text.message);
  },
  contacts(text) {
    trials = text.trials;
    controls.trials(trials);
  },
  contact(text) {
    bars.push({ distance: text.distance_m, met: text.met, colour: colourOf(text.style.split(" ")[0]) });
    contacts.set(bars);
    if (!text.past) judgedAt = performance.now();
  },
  experiment: (text) => ofExperiment(text), participant: (text) => ofExperiment(text), experimenter: (text) => ofExperiment(text),
  camera({ granted }) { webcam?.granted(granted); },
  say(text) { spoken(text.message); },
  over(text) {
    const report = text.report && `The report, on the computer that ran it, as soon as figures and film are made: ${text.report}`;
    const said = why && text.message.toLowerCase().includes(why.replace(/\.$/, "").toLowerCase());
    notice("over", [said ? "" : why, text.message, report].filter(Boolean).join("\n"));
    linkShown("calm", "over");
    linked = "over";
    ended = text.message;
    connection.close();
    controls.end();
    spoken("");
    experiment?.end?.();
    webcam?.end();
    headset?.finish();
  },
  headset(text) {
    notice("headset", refused = text.refused ? text.message : "");  // that it is hers now is said once
    if (!refused) headset?.spoken.say(text.message, performance.now());
  },
  touch(text) {
    if (stage) stage.contact(behind ? mirroredPoint(text.where) : text.where, performance.now());
    headset?.touch();
  },
};

let charted = null;
function figures(text) {
  const plate = text.plate_m !== undefined && stage?.met === "arm";
  const between = plate ? text.plate_m : text.palms_m;
  byId("palms").textContent = metres(between);
  for (const name of [byId("palms"), byId("palms-strip")]) name.previousElementSibling.firstChild.textContent = plate ? "plate to palm " : "palm to palm ";
  const left = text.time_to_contact_s;
  byId("contact").textContent = left === null || left === undefined || left > 1.5 || left < -0.3 ? "–" : left <= 0 ? "now" : `${left.toFixed(2)} s`;
  byId("markers").parentElement.hidden = !text.markers;
  byId("markers").textContent = text.markers ? `${text.tracked} of ${text.markers}` : "–";
  if (text.trial !== charted) for (const strip of Object.values(strips)) strip.clear();
  charted = text.trial;
  strips.palms.add(text.time_s, between === null ? null : 100 * between);
  strips.correction.add(text.time_s, text.correction);
}

/** What is said to the person: large, and in the headset that she wears. */
function spoken(message) { headset?.spoken.say(message, performance.now()); const place = byId("spoken"); place.textContent = message; place.hidden = !message; }

/** What who wears a headset must know for as long as it holds; '' where all goes on. */
function standing() {
  if (linked === "over") return ended;
  if (BROKEN[linked]) return [why, BROKEN[linked][1]].filter(Boolean).join(" ");
  return why || refused || { paused: PAUSED, "no new poses": STALE }[said] || "";
}

let webcam = null;
/** The camera's panel, and her view of the avatar. */
async function openWebcam() {
  if (webcam) { webcam.claim(); return; }
  const { Webcam } = await import("./webcam.js");
  const panel = document.createElement("section");
  place(panel);
  webcam = new Webcam(connection, panel, { processor: !stage || stage.quality.now.coarse });
  window.highfive.webcam = webcam;
  const button = Object.assign(document.createElement("button"), { textContent: "Mirror", onclick: () => choose(button) });
  button.dataset.view = "mirror";
  byId("views").prepend(button);
  choose(button);
  webcam.claim();
}

let experiment = null, untold = [];
/** Its panels; what is told before they are there waits. */
async function openExperiment() {
  if (experiment) return;
  experiment = "opening";
  const room = await import("./experiment.js");
  experiment = window.highfive.experiment = room.openExperiment(connection, addPanel, headset);
  for (const text of untold.splice(0)) ofExperiment(text);
  const view = byId("views").querySelector(`[data-view="${experiment.experimenter ? "orbit" : "person"}"]`);
  if (view) choose(view);
}
const ofExperiment = (text) => {
  if (!experiment?.hear) { untold.push(text); return; }
  experiment.hear(text);
  if (text.kind !== "experiment" || !stage) return;
  const takesPart = !experiment.experimenter;
  stage.signs.hidden = { markers: takesPart, palms: takesPart || text.taps };  // who takes part sees whom she meets
  stage.eye.near = Boolean(text.taps);
  stage.eye.look(stage.eye.name);
};

/** Panels of other rooms: a text of a kind that none of ours has goes to who asked for it. */
const listeners = new Map();
function place(element) {
  byId("panels").append(element);
  controls.giveWay();
}
function panel(text) { for (const hear of listeners.get(text.kind) || []) hear(text); }
export function addPanel(element, kind, hear) {
  place(element);
  listeners.set(kind, [...(listeners.get(kind) || []), hear]);
}

const streams = new Streams();
addPanel(streams.element, "streams", (text) => streams.show(text.streams));

function choose(button) {
  if (stage) stage.view(button.dataset.view);
  document.body.dataset.view = button.dataset.view;
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
    if (stage) stage.contact(behind ? mirroredPoint(trial.where) : trial.where, performance.now());
    headset?.touch();
    const bar = { distance: trial.distance_m, met: trial.met, colour: colourOf(trial.style.split(" ")[0]) };
    bars.push(bar);
    contacts.set(bars);
  }
  shownContact = past;
}

new ResizeObserver(([{ target }]) => {  // what is said has a place of its own: all else is below it
  document.body.style.setProperty("--told", `${target.offsetHeight}px`);
}).observe(byId("told"));
new ResizeObserver(([{ target }]) => {  // further panels have what controls leave
  document.body.style.setProperty("--controls", `${target.offsetHeight}px`);
}).observe(byId("controls"));
if (stage) keepClear(["told", "figures", "timeline", "controls", "panels", "caption"].map(byId), (now) => { free = now; clear(); });

setInterval(() => { for (const strip of Object.values(strips)) strip.draw(); }, CHARTS_MS);

const drawn = { frames: 0, since: performance.now(), ages: [], frame: 16, before: 0, number: 0, told: [], captured: 0, fresh: 0 };
function frame(now, seen) {
  const gap = now - drawn.before;  // a tab that was hidden has dropped nothing
  const dropped = gap < 1000 ? Math.max(Math.round(gap / drawn.frame) - 1, 0) : 0;
  drawn.frame += 0.1 * (Math.min(now - drawn.before, 50) - drawn.frame);
  drawn.before = now;
  // When this picture is on the screen: a headset says so.
  const time = connection.host(seen ? seen.predictedDisplayTime ?? now + drawn.frame : now + drawn.frame);
  const shown = motion.at(time);
  if (shown && stage) {
    stage.pose(shown.bodies);
    stage.showMarkers(shown.markers, shown.seen);
    if (drawn.told.length < MOST_TOLD && connection.synchronised) drawn.told.push([drawn.number, shown.holds, time, dropped]);
    if (motion.newest.captured > drawn.captured) {  // each that was measured since, once, as it is first shown
      if (motion.newest.rate) { drawn.ages.push(time - motion.newest.captured); drawn.fresh = now; }
      drawn.captured = motion.newest.captured;
    }
    if (drawn.ages.length > 600) drawn.ages.shift();
    passContact(shown.time);
  }
  const stale = shown && connection.synchronised && shown.age > FROZEN_MS;
  const still = state.paused || state.playing === false;
  // Between two high fives nothing need come: of a session, or of a recording that rests while its next one is read.
  const idle = !shown || (stale && (judgedAt > arrived - FRESH_MS || experiment?.idle || (state.playing && motion.newest.rate === 0)));
  const status = linked !== "good" ? "" : still ? "paused" : stage && !stage.ready ? "loading" : idle ? "waiting" : stale ? "no new poses" : state.playing ? "playing" : "live";
  if (status && status !== said) linkShown({ live: "good", playing: "good", "no new poses": "" }[status] ?? "calm", status);
  said = status;
  frozen = stale;
  if (seen && headset?.session) {
    headset.standing.tell(standing(), performance.now());
    headset.frame(seen);
  }
  if (stage && stage.ready) stage.draw(now);
  if (stage && stage.values) document.body.classList.add("shown");
  drawn.frames += 1;
  drawn.number += 1;
}
setInterval(() => connection.tellShown(drawn.told.splice(0)), TOLD_MS);
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
  const { poses, lost } = connection.counts;  // a page that is slow, or asleep, is sent the newest only
  byId("dropped").textContent = poses ? (lost ? `${lost} of ${poses + lost}` : "none") : "–";
  if (now > drawn.fresh + FRESH_MS) drawn.ages.length = 0;
  if (drawn.ages.length) byId("latency").parentElement.hidden = false;
  byId("latency").textContent = drawn.ages.length ? `${median(drawn.ages).toFixed(0)} ms` : "–";
}, 500);

let judged = false;
setInterval(() => {
  const now = performance.now(), rate = (1000 * drawn.frames) / (now - drawn.since);
  window.highfive.fps = rate;
  // The first stretch is compiling and uploading; a hidden tab draws nothing and says nothing of the machine.
  if (stage && stage.ready && judged && !document.hidden && !headset.session) stage.judge(rate);
  judged = Boolean(stage && stage.ready);
  Object.assign(drawn, { frames: 0, since: now });
}, JUDGED_MS);

/** For benches and tests. */
window.highfive = { connection, motion, stage, headset, counts: connection.counts, ages: drawn.ages, fps: 0, state: () => state, frozen: () => frozen };

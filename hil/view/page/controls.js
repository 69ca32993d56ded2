// The style dial, the buttons, the timeline: what is asked of the host.

import { listen } from "./keys.js";
import { colourOf, moodOf, weightsOf } from "./moods.js";
import { Stop } from "./stop.js";

const byId = (id) => document.getElementById(id);
const SMALL = matchMedia("(max-width: 760px), (max-height: 520px)"), LOW = matchMedia("(max-height: 800px)");

export class Controls {
  constructor(command) {
    this.command = command;
    this.weights = {};
    byId("mix").onclick = () => this.fold(!byId("controls").classList.contains("brief"));
    this.fold(SMALL.matches);
    byId("correct").onchange = (event) => command("correct", event.target.checked);
    byId("cell").onchange = (event) => command("cell", event.target.value);
    byId("pause").onclick = () => command("pause", !this.paused);
    byId("again").onclick = () => command("again");
    byId("next").onclick = () => command("next");
    byId("end").onclick = () => command("end");
    this.stop = new Stop(byId("estop"), () => command("estop"));
    byId("play").onclick = () => command("pause", this.playing);
    byId("back").onclick = () => command("step", -1);
    byId("forth").onclick = () => command("step", 1);
    byId("seek").oninput = (event) => { this.sought = performance.now(); command("seek", Number(event.target.value)); };
    byId("speed").onchange = (event) => command("speed", Number(event.target.value));
    byId("trials").onchange = (event) => command("trial", Number(event.target.value));
    listen(() => (this.stop.there ? () => this.stop.ask() : null), () => this.keys);
  }

  /** On a small screen moods are buttons alone, until somebody wants a mixture. */
  fold(brief) {
    byId("controls").classList.toggle("brief", brief);
    byId("mix").setAttribute("aria-expanded", String(!brief));
    byId("mix").textContent = brief ? "Mix" : "Fewer";
  }

  /** Another panel shares the side of the window. */
  giveWay() { if (LOW.matches) this.fold(true); }

  /** What keys do now; the emergency stop has a way of its own. */
  get keys() {
    const press = (name) => () => byId(name).click();
    if (["experiment", "played"].includes(this.mode)) return {};
    return this.mode === "recording"
      ? { " ": press("play"), ArrowLeft: press("back"), ArrowRight: press("forth") }
      : { " ": press("pause"), n: press("next"), a: press("again") };
  }

  /** Nothing can be asked any more. */
  end() {
    this.stop.link(false);
    for (const one of document.querySelectorAll(".controls, .timeline")) {
      for (const control of one.querySelectorAll("button, input, select")) control.disabled = control.id !== "mix";
    }
  }

  /** What can be asked here, from the first message. */
  begin(hello) {
    this.mode = hello.mode;
    const played = hello.mode === "played";  // by an arm, from a recording: what the avatar did is settled
    byId("controls").hidden = !played && hello.mode !== "session";
    for (const one of document.querySelectorAll(".answering")) one.hidden = played;
    byId("timeline").hidden = hello.mode !== "recording";
    byId("estop").hidden = !hello.arm;
    byId("cell-row").hidden = !(hello.cells || []).length;
    byId("cell").replaceChildren(...(hello.cells || []).map((cell) => new Option(cell, cell)));
    this.moods(hello.emotions || []);
  }

  moods(emotions) {
    this.sliders = new Map();
    byId("moods").replaceChildren(...emotions.map((emotion, place) => {
      const row = document.createElement("div");
      row.className = "mood";
      row.style.setProperty("--tint", colourOf(emotion, place));
      const button = Object.assign(document.createElement("button"), { textContent: emotion });
      const slider = Object.assign(document.createElement("input"), { type: "range", min: 0, max: 1, step: 0.01, value: 0 });
      slider.setAttribute("aria-label", `share of ${emotion}`);
      const output = document.createElement("output");
      button.onclick = () => this.ask({ [emotion]: 1 });
      slider.oninput = () => this.ask(this.mixed(emotion, Number(slider.value)));
      row.append(button, slider, output);
      this.sliders.set(emotion, { button, slider, output });
      return row;
    }));
  }

  /** One emotion at that share, the others in their proportion. */
  mixed(emotion, share) {
    const others = [...this.sliders.keys()].filter((name) => name !== emotion);
    const rest = others.reduce((sum, name) => sum + (this.weights[name] || 0), 0);
    const weights = { [emotion]: share };
    for (const name of others) weights[name] = rest > 0 ? ((1 - share) * (this.weights[name] || 0)) / rest : (1 - share) / others.length;
    return weights;
  }

  ask(weights) {
    const kept = Object.fromEntries(Object.entries(weights).filter(([, weight]) => weight > 0.004));
    if (!Object.keys(kept).length) return;
    this.asked = performance.now();
    this.command("style", kept);
    this.showStyle(weights);
  }

  showStyle(weights) {
    this.weights = weights;
    for (const [emotion, { button, slider, output }] of this.sliders || []) {
      const weight = weights[emotion] || 0;
      if (document.activeElement !== slider || performance.now() - (this.asked || 0) > 1000) slider.value = weight;
      output.textContent = `${Math.round(100 * weight)}\u00a0%`;
      button.classList.toggle("whole", weight > 0.995);
    }
  }

  /** How it stands, from the host. */
  state(state) {
    if (this.mode === "recording") {
      this.playing = state.playing;
      byId("play").textContent = state.playing ? "❚❚" : "▶";
      const seek = byId("seek");
      seek.max = state.length_s;
      if (performance.now() - (this.sought || 0) > 300) seek.value = state.time_s;
      byId("clock").textContent = `${state.time_s.toFixed(2)} s`;
      const mark = byId("mark");
      mark.hidden = state.contact_s === null;
      if (state.contact_s !== null) mark.style.left = `calc(8px + ${state.contact_s / state.length_s} * (100% - 16px))`;
      byId("speed").value = String(state.speed);
      byId("play").setAttribute("aria-pressed", String(state.playing));
      if (document.activeElement !== byId("trials")) byId("trials").value = String(state.trial);
      return;
    }
    this.paused = state.paused;
    byId("pause").textContent = state.paused ? "Go on" : "Pause";
    if (document.activeElement !== byId("correct")) byId("correct").checked = state.corrected;
    if (document.activeElement !== byId("cell")) byId("cell").value = state.cell;
    if (performance.now() - (this.asked || 0) > 700) this.showStyle(state.weights || {});
    this.stop.told(Boolean(state.stopped));
  }

  trials(trials) {
    const cells = new Set(trials.map((trial) => trial.cell));
    const name = ({ number, style, cell }) => `${number} · ${moodOf(weightsOf(style))}${cell && cells.size > 1 ? ` · ${cell}` : ""}`;
    byId("trials").replaceChildren(...trials.map((trial, i) => new Option(name(trial), i)));
  }
}

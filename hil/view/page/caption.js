// What is seen, in words: the mood, large, and which high five it is.

import { colourOf, moodOf, weightsOf } from "./moods.js";

const NEWCOMER = "The person in orange raises her hand. The avatar in blue-green answers.";

export class Caption {
  constructor(mood, about) { Object.assign(this, { mood, about, hello: {} }); }

  begin(hello) {
    this.hello = hello;
    this.state({});
  }

  state(state) {
    const { hello } = this, recorded = hello.mode === "recording";
    const mood = moodOf(state.weights || weightsOf(state.style || ""));
    this.write(this.mood, mood);
    this.mood.parentElement.classList.toggle("mixed", mood.includes("%") || mood.includes("+"));
    this.mood.style.setProperty("--tint", colourOf(mood.split(/\s/)[0]));
    // A recording's have their own numbers: some may be left out.
    const which = state.trials ? `High five ${state.number ?? state.trial + 1} of ${state.last ?? state.trials}` : "";
    const more = recorded && !hello.title ? NEWCOMER : state.cell ? `hand raised at ${state.cell}` : "";
    this.write(this.about, [which, more].filter(Boolean).join("\n"));
  }

  write(place, text) { if (place.textContent !== text) place.textContent = text; }
}

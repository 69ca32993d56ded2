// An experiment: the participant's side (cue, answer, sliders), and the experimenter's (plan, progress, what comes next).

import { Board, taskOf } from "./board.js";
import { markdown } from "./markdown.js";

const IDLE = new Set(["ready", "wait", "question", "pause", "over"]);  // nothing need move meanwhile
const TONE_HZ = 660, TONE_S = 0.18;

const made = (kind, fields = {}, ...children) => {
  const element = Object.assign(document.createElement(kind), fields);
  element.append(...children.filter((child) => child !== null));
  return element;
};

/** A short tone; a page that nobody has touched yet may not make one. */
let sound = null;
function tone() {
  try {
    sound = sound || new AudioContext();
    const [swing, loud] = [sound.createOscillator(), sound.createGain()];
    swing.frequency.value = TONE_HZ;
    loud.gain.setValueAtTime(0.2, sound.currentTime);
    loud.gain.exponentialRampToValueAtTime(0.001, sound.currentTime + TONE_S);
    swing.connect(loud).connect(sound.destination);
    swing.start();
    swing.stop(sound.currentTime + TONE_S);
  } catch { /* a browser without sound: the word alone */ }
}

/** What a participant sees and presses. */
class Participant {
  constructor(connection, own, headset) {
    Object.assign(this, { connection, own, headset, about: null, now: { phase: "" }, board: headset && new Board(this) });
    headset?.ask(this.board);
    this.element = made("section", { className: "participant", hidden: true });
    this.element.setAttribute("aria-live", "polite");
    addEventListener("keydown", (event) => this.key(event), { capture: true });
  }

  /** Only on the participant's own page, or where no other is: there keys are answers. */
  key(event) {
    if (!this.own || event.repeat || event.ctrlKey || event.metaKey || event.altKey || event.target.type === "text") return;
    const { phase, asks } = this.now;
    if (phase === "question" && asks === "answer" && event.key.length === 1 && event.key !== " ") this.answer(event.key, event.timeStamp);
    else if (event.key === "Enter" && phase === "ready") this.connection.command("ready");
    else if (event.key === "Enter" && phase === "question" && asks === "rate") this.done();
    else return;
    event.preventDefault();
    event.stopImmediatePropagation();
  }

  answer(key, at) {
    const { connection } = this;
    connection.command("answer", connection.synchronised ? { key, at_ms: connection.host(at) } : { key });
  }

  done() { this.connection.command("done"); }

  begin(about) { this.about = about; this.show(this.now); }

  show(now) {
    const came = now.phase !== this.now.phase;
    this.now = now;
    if (!this.about) return;
    if (now.phase === "cue" && came && this.own) tone();
    const content = (this[now.phase] || (() => [])).call(this, now);
    this.element.replaceChildren(...content);
    this.element.className = `participant ${now.phase}`;
    this.element.hidden = !content.length;
    this.board?.tell(now);
    const said = { cue: [this.about.words[now.task], now.text], wait: [now.text] }[now.phase];  // above the avatar, who is to be seen
    if (came || said) this.headset?.spoken.say((said || []).filter(Boolean).join(". "), performance.now());
  }

  ready({ first, practice, task, text: said }) {
    const { words } = this.about;
    const go = made("button", { className: "go", textContent: `${words.go_on} (Enter)`, onclick: () => this.connection.command("ready") });
    const text = first ? markdown(this.about.instructions) : [];
    if (said || !first) text.push(made("h3", { textContent: said || (practice ? words.practice : words.next_block) }));
    return [...text, made("p", { textContent: taskOf(this.about, task) }), go];
  }

  wait({ text }) { return text ? [made("p", { textContent: text })] : []; }

  cue({ task, text }) { return [made("strong", { textContent: this.about.words[task] }), ...this.wait({ text })]; }

  pause() { return [made("p", { textContent: this.about.words.pause })]; }

  over({ finished }) { return [made("p", { textContent: finished ? this.about.words.finished : this.about.words.ends })]; }

  question({ asks, answer }) {
    const { keys, sliders, words, shown } = this.about;
    const buttons = made("div", { className: "answers" }, ...Object.entries(keys).sort((a, b) => a[1].localeCompare(b[1])).map(([label, key]) => {
      const button = made("button", { disabled: asks !== "answer", onclick: (event) => this.answer(key, event.timeStamp) }, made("kbd", { textContent: key }), made("span", { textContent: shown[label] }));
      button.classList.toggle("chosen", label === answer);
      return button;
    }));
    if (asks !== "rate") return [made("h3", { textContent: words.question }), buttons];
    return [buttons, ...sliders.map((slider) => this.slider(slider)), made("button", { className: "go", textContent: `${words.done} (Enter)`, onclick: () => this.done() })];
  }

  slider({ name, text, low, high, points }) {
    const input = made("input", { type: "range", min: points ? 1 : 0, max: points || 1, step: points ? 1 : 0.01, value: points ? (points + 1) / 2 : 0.5 });
    input.setAttribute("aria-label", text);
    const row = made("label", { className: "rating untouched" }, made("span", { textContent: text }), input, made("small", { textContent: low }), made("small", { textContent: high }));
    input.onchange = () => { row.classList.remove("untouched"); this.connection.command("rate", { name, value: Number(input.value) }); };
    input.onpointerdown = () => row.classList.remove("untouched");
    return row;
  }
}

/** What the experimenter sees and asks for. */
class Experimenter {
  constructor(connection) {
    const ask = (name, value) => () => connection.command(name, value);
    this.note = made("input", { type: "text", placeholder: "a note to this trial, Enter", maxLength: 2000 });
    this.note.onkeydown = (event) => {
      event.stopPropagation();
      if (event.key !== "Enter" || !this.note.value.trim()) return;
      connection.command("note", this.note.value.trim());
      this.note.value = "";
    };
    this.lines = made("div");
    this.pause = made("button", { textContent: "Pause", onclick: () => connection.command("pause", !this.now?.paused) });
    this.stop = made("button", { textContent: "Stop", onclick: () => this.sure() && connection.command("stop") });
    this.element = made("section", { className: "experimenter" }, this.lines,
      made("div", { className: "row" }, this.pause, made("button", { textContent: "Break off", onclick: ask("break_off") }), made("button", { textContent: "Begin", title: "the block, for the participant", onclick: ask("ready") }), this.stop),
      this.note);
  }

  sure() { return confirm("Stop the run? It goes on with --resume; a block that has begun begins again."); }

  begin(about) { this.about = about; }

  trial(when, { trial, weights, style, cell, condition }) {
    const shares = Object.entries(weights || {}).filter(([, share]) => share > 0);
    const what = shares.length ? shares.map(([name, share]) => (share > 0.995 ? name : `${name} ${share.toFixed(2)}`)).join(" + ") : style;
    return made("p", { className: when }, `${when} `, made("b", { textContent: trial }), ` ${what || ""} ${cell || ""} ${(condition || "").replaceAll("_", " ")}`);
  }

  show(now) {
    this.now = now;
    this.pause.textContent = now.paused ? "Go on" : "Pause";
    const done = (now.blocks || []).reduce((sum, block) => sum + block.done, 0), all = (now.blocks || []).reduce((sum, block) => sum + block.trials, 0);
    const last = now.last;
    this.lines.replaceChildren(...[
      made("h2", { textContent: `${this.about?.participant || ""} · trial ${Math.min(done + 1, all)} of ${all}` }),
      made("ol", { className: "blocks" }, ...(now.blocks || []).map((block) => {
        const bar = made("i");
        bar.style.width = `${(100 * block.done) / block.trials}%`;
        return made("li", { title: `${block.mode.replaceAll("_", " ")}, ${block.done} of ${block.trials}` }, made("span", { textContent: block.name }), made("b", {}, bar));
      })),
      now.trial ? this.trial("now", now) : null,
      now.next ? this.trial("next", now.next) : null,
      now.asks ? made("p", { className: "asks", textContent: now.asks === "rate" ? `answered ${now.answer}; the sliders are asked` : "the answer is asked" }) : null,
      last ? made("p", { className: "last", textContent: `last ${last.trial}: ${last.answer || "–"}${last.expected ? (last.answer === last.expected ? " ✓" : ` (was ${last.expected})`) : ""}${last.rt_s ? `, ${last.rt_s.toFixed(2)} s` : ""}${last.why ? `, ${last.why}` : ""}` }) : null,
      now.message ? made("p", { className: "message", textContent: now.message }) : null,
    ].filter(Boolean));
  }
}

const hearNothing = () => {};  // texts come through hear() below, also those of before the panels were there

/** Puts what this page is for into its places. */
export function openExperiment(connection, addPanel, headset) {
  const own = new URLSearchParams(location.search).get("role") === "participant";
  const participant = new Participant(connection, own, headset);
  document.body.classList.add("experiment", own ? "blind" : "leading");
  const sheet = made("link", { rel: "stylesheet", href: "experiment.css" });
  document.head.append(sheet);
  if (own) document.body.append(participant.element);
  else addPanel(participant.element, "participant", hearNothing);
  const experimenter = own ? null : new Experimenter(connection);
  const hear = {
    experiment(text) {
      document.body.classList.toggle("tapping", Boolean(text.taps));  // palms do not meet
      participant.begin(text);
      experimenter?.begin(text);
    },
    participant(text) { participant.show(text); },
    experimenter(text) { experimenter?.show(text); },
  };
  if (experimenter) addPanel(experimenter.element, "experimenter", hearNothing);
  return {
    participant, experimenter, get idle() { return IDLE.has(participant.now.phase); }, hear(text) { hear[text.kind]?.(text); },
    end() { if (participant.now.phase !== "over") participant.show({ phase: "over", finished: false }); },  // nothing is asked any more
  };
}

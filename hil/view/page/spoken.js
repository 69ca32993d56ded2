// What is said to who wears a headset: for some seconds on a panel above the avatar, as she is seen.

import { Panel } from "./panel.js";

const AWAY = 1.0, ABOVE = 0.34;  // m before her eyes, and over them
const SHOWN_MS = 7000, FADE_MS = 500;

export class Spoken extends Panel {
  constructor() {
    super();
    Object.assign(this, { since: -Infinity, stands: false, renderOrder: 900 });
  }

  /** A text; the last one is shown again to who comes later. */
  say(text, now) {
    Object.assign(this, { since: text ? now : -Infinity, stands: false });
    this.write(text);
  }

  /** Before each picture: put once where she looks, upright, then it stands still, for what moves with a head makes sick. */
  show(eyes, turn, now) {
    const left = SHOWN_MS - (now - this.since);
    this.visible = left > 0;
    if (!this.visible) return;
    this.material.opacity = Math.min(left / FADE_MS, 1);
    if (this.stands) return;
    this.stands = true;
    this.stand(eyes, turn, AWAY, ABOVE);
  }
}

// How it stands, to who wears a headset: on a panel below her eyes for as long as it holds (paused, lost, over).

import { Panel } from "./panel.js";
import { Vector3 } from "./three.js";

const AWAY = 0.75, BELOW = 0.26;  // m: before the avatar's chest, where text is read with the head at rest
const HELD_MS = 400, FADE_MS = 300;  // what is over sooner is not told
const BESIDE = Math.cos(Math.PI / 3);  // who has turned away further than that has it put before her again

export class Standing extends Panel {
  constructor() {
    super();
    Object.assign(this, { told: "", since: 0, stands: false, renderOrder: 1100 });  // also on the dark of the end
    this.material.depthTest = false;
  }

  /** What holds now; '' for nothing that need be told. */
  tell(text, now) {
    if (text === this.told) return;
    if (!this.told || !text) this.stands = false;
    Object.assign(this, { told: text, since: this.visible ? now - HELD_MS - FADE_MS : now });
    if (text) this.write(text);
  }

  /** Before each picture. */
  show(eyes, turn, now) {
    const held = now - this.since - HELD_MS;
    this.visible = Boolean(this.told) && held >= 0;
    if (!this.visible) return;
    const ahead = new Vector3(0, 0, -1).applyQuaternion(turn).setY(0).normalize();
    const there = this.position.clone().sub(eyes).setY(0).normalize();
    if (this.stands && ahead.dot(there) < BESIDE) Object.assign(this, { stands: false, since: now - HELD_MS });
    if (!this.stands) this.stand(eyes, turn, AWAY, -BELOW);
    this.stands = true;
    this.material.opacity = Math.min((now - this.since - HELD_MS) / FADE_MS, 1);
  }
}

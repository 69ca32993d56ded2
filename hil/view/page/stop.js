// The emergency stop on the page: one button, and what it can say of itself.

const ASK = "EMERGENCY STOP", ASKED = "STOP ASKED – not yet acknowledged";
const STOPPED = "STOPPED – let go at the host", DEAD = "NOT CONNECTED: stop at the host";

export class Stop {
  /** @param {HTMLButtonElement} button  @param {() => void} pull */
  constructor(button, pull) {
    Object.assign(this, { button, pull, linked: false, asked: false, stopped: false });
    button.onclick = () => this.ask();
    this.show();
  }

  /** There is an arm that it stops. */
  get there() { return !this.button.hidden; }

  ask() {
    if (!this.linked) return;
    this.asked = true;
    this.pull();
    this.show();
  }

  /** Whether the host is heard: a stop that cannot be asked for must not look as if it could. */
  link(linked) {
    if (linked === this.linked) return;
    this.linked = linked;
    if (!linked) this.asked = this.stopped = false;  // nobody knows any more
    this.show();
  }

  /** What the host says of it. */
  told(stopped) {
    if (stopped) this.asked = false;
    this.stopped = stopped;
    this.show();
  }

  show() {
    const { button, linked, asked, stopped } = this;
    button.disabled = !linked;
    button.textContent = !linked ? DEAD : stopped ? STOPPED : asked ? ASKED : ASK;
    button.classList.toggle("pulled", linked && stopped);
    button.classList.toggle("asked", linked && asked && !stopped);
  }
}

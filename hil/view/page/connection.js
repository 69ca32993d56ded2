// The link to the server: the newest poses, texts in order, the host's clock. Reconnects by itself.

const VERSION = 2, HEAD = 40, RETRY_MS = 500, ASK_MS = 1000, KEPT = 10, MOST_WAITING = 3000, MOST_UNANSWERED = 3;
const SLEW = 0.0005, SET_MS = 20;  // how quickly a better answer is followed, as a fraction, and what says that a clock was set

/** This page's own name, also after it was reloaded: whose headset it is. A browser that keeps nothing gives a new one. */
const NAME = (() => {
  const name = () => crypto.getRandomValues(new Uint32Array(4)).join("-");
  try { return sessionStorage.page ??= name(); } catch { return name(); }
})();

/** A pose message; times in ms of the host's monotonic clock. */
export function decodePoses(buffer) {
  const view = new DataView(buffer);
  const bodies = view.getUint8(2), markers = view.getUint8(3);
  const ms = (at) => Number(view.getBigInt64(at, true)) / 1e6;
  return {
    version: view.getUint8(1), number: view.getUint32(4, true), holds: ms(8), captured: ms(16), sent: ms(24),
    rate: view.getFloat32(32, true), time: view.getFloat32(36, true),
    bodies: new Float32Array(buffer, HEAD, 7 * bodies),
    markers: new Float32Array(buffer, HEAD + 28 * bodies, 3 * markers),
    seen: new Uint8Array(buffer, HEAD + 28 * bodies + 12 * markers, markers),
  };
}

export class Connection {
  /** @param {{poses: Function, text: Function, link: Function}} listeners */
  constructor(listeners) {
    this.listeners = listeners;
    this.answers = [];  // round trip and offset of the last questions for the time
    this.offset = this.moved = 0;  // what is added to this page's time, ms, and until when it was moved
    this.counts = { poses: 0, lost: 0, latencies: [] };
    this.last = null;
    this.open();
  }

  open() {
    const address = new URL("live", location.href);
    address.protocol = address.protocol.replace("http", "ws");
    address.search = location.search;
    address.searchParams.set("page", NAME);
    this.socket = new WebSocket(address);
    this.socket.binaryType = "arraybuffer";
    this.opened = false;
    this.socket.onopen = () => { this.opened = true; this.unanswered = 0; this.answers = []; for (let i = 0; i < KEPT; i++) setTimeout(() => this.ask(), 20 * i); };
    this.socket.onmessage = (event) => this.hear(event.data);
    this.socket.onclose = async () => {
      this.listeners.link(this.opened ? "lost" : await this.why());
      setTimeout(() => this.open(), RETRY_MS);
    };
    clearInterval(this.asking);
    this.asking = setInterval(() => {
      if (this.unanswered >= MOST_UNANSWERED) this.listeners.link("lost");  // a cable that was pulled closes nothing
      this.ask();
      this.unanswered += 1;
    }, ASK_MS);
  }

  /** Why no connection comes about: a server that is there says so to a plain question. */
  async why() {
    const answer = await fetch(`live${location.search}`, { cache: "no-store" }).catch(() => null);
    return { 403: "refused", 503: "full" }[answer?.status] || "lost";
  }

  /** For good. */
  close() {
    this.socket.onclose = null;
    clearInterval(this.asking);
    this.socket.close();
  }

  ask() { this.send({ kind: "time", asked: performance.now() }); }

  /** Pictures as [number, pose's time, time seen, dropped], ms of the host's clock: the only proof of what was seen. */
  tellShown(pictures) {
    if (pictures.length && this.synchronised) this.send({ kind: "shown", bound_ms: this.bound, pictures });
  }

  command(name, value) { this.send({ kind: "command", name, value }); }

  send(message) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
  }

  /** Bytes that are worth nothing later: none where earlier ones still wait. */
  sendNewest(bytes) {
    if (this.socket.readyState === WebSocket.OPEN && this.socket.bufferedAmount < MOST_WAITING) this.socket.send(bytes);
  }

  hear(data) {
    const now = performance.now();
    if (typeof data !== "string") {
      this.socket.send(data.slice(4, 8));  // acknowledged: the number
      const poses = decodePoses(data);
      if (poses.version !== VERSION) return;
      this.count(poses, now);
      this.listeners.poses(poses);
      return;
    }
    const text = JSON.parse(data);
    if (text.kind === "time") {
      this.unanswered = 0;
      this.answers.push({ trip: now - text.asked, offset: text.now_ms + (now - text.asked) / 2 - now });
      if (this.answers.length > KEPT) this.answers.shift();
      this.listeners.link("good");
    } else if (text.kind === "hello") {
      if (text.version !== VERSION) { this.close(); this.listeners.link("old"); return; }
      if (text.run !== this.run) { this.last = null; Object.assign(this.counts, { poses: 0, lost: 0 }); }
      this.run = text.run;
      this.listeners.text(text);
    } else {
      this.listeners.text(text);
    }
  }

  count(poses, now) {
    const { counts } = this;
    if (this.last !== null && poses.number > this.last + 1) counts.lost += poses.number - this.last - 1;
    this.last = poses.number;
    counts.poses += 1;
    if (this.answers.length && counts.latencies.length < 20000) counts.latencies.push(this.host(now) - poses.sent);
  }

  /** Host time, ms, of a time of performance.now(): by the answer that took least, which is followed slowly once there are
   *  many: what is drawn and tracked by it must not leap. */
  host(now) {
    if (!this.answers.length) return now;
    const gap = this.best().offset - this.offset, passed = Math.max(now - this.moved, 0);
    const slow = this.answers.length >= KEPT && Math.abs(gap) < SET_MS;  // else, as at the beginning, at once
    this.offset += slow ? Math.max(-SLEW * passed, Math.min(gap, SLEW * passed)) : gap;
    this.moved = Math.max(now, this.moved);
    return now + this.offset;
  }

  /** The answer that took least: half of its trip is how far its offset can be off. */
  best() { return this.answers.reduce((best, one) => (one.trip < best.trip ? one : best)); }

  /** How far host() can be off, ms: what is still to be followed of the best answer comes on top. */
  get bound() { const best = this.best(); return best.trip / 2 + Math.abs(best.offset - this.offset); }

  get synchronised() { return this.answers.length > 0; }
}

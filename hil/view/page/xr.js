// In a headset: the avatar life-size before the person, floor on the floor; her own hands drawn, her own body hidden.

import { rayOf } from "./board.js";
import { Spoken } from "./spoken.js";
import { Standing } from "./standing.js";
import { LIMBS, Tracked } from "./tracked.js";
import { CylinderGeometry, InstancedMesh, Matrix4, MeshStandardMaterial, Quaternion, SphereGeometry, Vector3 } from "./three.js";

const FEATURES = { requiredFeatures: ["local-floor"], optionalFeatures: ["hand-tracking", "body-tracking"] };
const MODES = { "immersive-vr": "Enter VR", "immersive-ar": "Enter AR" }, LEAVE = "Leave";
const UP = new Vector3(0, 1, 0);
// m between her eyes and the avatar where palms meet at an arm's length, for eyes at this height; with bounds for others.
const STAND_OFF = 1.0, EYES = 1.674, NEAREST = 0.85, FURTHEST = 1.15;
const FADE_MS = 600, PULSE = [0.8, 60];  // share of the strength, ms
const READ_MS = 8000, DARK_MS = 1200;  // at the end: until she is let out, who reads why; and until it is dark
const JOINTS = 25;
// Bones from joint to joint, in the order of XRHand: the wrist, four joints of the thumb, five of each finger.
const BONES = [[1, 2, 3, 4], ...[5, 10, 15, 20].map((first) => [0, 1, 2, 3, 4].map((i) => first + i))]
  .flatMap((finger) => [0, ...finger].slice(1).map((joint, i) => [[0, ...finger][i], joint]));

export class Headset {
  /**
   * @param {Stage} stage
   * @param {HTMLElement} place for the buttons
   * @param {(text: string) => void} say
   * @param {() => void} changed: what can be entered, or whether it is
   */
  constructor(stage, place, say, changed) {
    Object.assign(this, { stage, place, say, changed, modes: null, session: null, send: null, space: null, places: 0, counts: { frames: 0, hands: 0, lost: 0, sent: 0 } });
    this.spoken = new Spoken();
    this.standing = new Standing();
    stage.scene.add(this.spoken, this.standing);
    this.hands = ["left", "right"].map(() => this.hand());
    this.offer();
    navigator.xr?.addEventListener("devicechange", () => this.offer());
  }

  /** From now on what is tracked is sent: ``send(message)``, for a time ``host(ms)`` of the host's, and ``over()`` once
   *  nobody wears it any more; null for not. */
  track(send, host, over) { Object.assign(this, { send, host, over }); }

  /** A button for each way in that this browser has. */
  async offer() {
    const buttons = [];
    for (const [mode, label] of Object.entries(MODES)) {
      const has = await navigator.xr?.isSessionSupported(mode).catch(() => false);
      if (!has) continue;
      const button = Object.assign(document.createElement("button"), { textContent: label });
      button.dataset.mode = mode;
      button.onclick = () => (this.session ? this.leave(FADE_MS, FADE_MS) : this.enter(mode).catch((error) => this.say(`${label} failed: ${error.message}`)));
      buttons.push(button);
    }
    this.place.replaceChildren(...buttons);
    this.place.hidden = !buttons.length;
    this.modes = buttons.map((button) => button.textContent);
    this.label();
    this.changed();
  }

  /** While one is worn the button lets her out; once all is over nobody is let in. */
  label() {
    for (const button of this.place.children) {
      button.textContent = this.session ? LEAVE : MODES[button.dataset.mode];
      button.disabled = Boolean(this.finished && !this.session);
    }
  }

  /** What keeps a headset from being entered here; "" if nothing does, null as long as the browser has not answered. */
  get lacking() {
    if (!navigator.xr) return "This browser has no WebXR: open the page in the headset's own browser, by cable or over https.";
    if (!this.modes) return null;
    return this.modes.length ? "" : "This browser has WebXR, but finds no headset: open the page in the headset's own browser, or connect one.";
  }

  async enter(mode) {
    const { stage } = this;
    const session = await navigator.xr.requestSession(mode, FEATURES);
    this.sound ??= new AudioContext();  // here, for browsers let sound begin only when somebody has pressed something
    stage.renderer.xr.enabled = true;
    stage.renderer.xr.setReferenceSpaceType("local-floor");
    await stage.renderer.xr.setSession(session);
    this.session = session;
    this.began = performance.now();
    this.ends = null;
    this.placed = false;
    stage.immerse(mode === "immersive-ar");
    session.addEventListener("end", () => this.left());
    session.addEventListener("select", (event) => this.chosen(event));
    stage.renderer.xr.getReferenceSpace().addEventListener("reset", () => { this.placed = this.spoken.stands = this.standing.stands = false; this.board?.leave(); });
    this.spoken.say(this.spoken.text, this.began);
    this.standing.stands = false;
    this.label();
    this.changed();
  }

  /** It is over: she reads why, on the dark, and is let out. */
  finish() {
    this.finished = true;
    this.leave(DARK_MS, READ_MS);
    this.label();
  }

  /** Lets her out after so long, ms; it is dark by ``dark``, but not where she sees her own room, in which she may walk. */
  leave(dark, after) {
    if (this.session && !this.ends) this.ends = { from: performance.now(), dark, after };
  }

  /** How light it is, 0 to 1: comfortable beginnings and ends. */
  light(now) {
    const begun = Math.min((now - this.began) / FADE_MS, 1);
    return this.ends && !this.stage.passthrough ? Math.min(begun, Math.max(1 - (now - this.ends.from) / this.ends.dark, 0)) : begun;
  }

  left() {
    this.session = null;
    if (this.send) this.over();
    this.stage.renderer.xr.enabled = false;
    for (const hand of this.hands) hand.visible = false;
    this.spoken.visible = this.standing.visible = false;
    this.board?.leave();
    this.stage.emerge();
    this.label();
    this.changed();
  }

  /** Before each picture of the headset. */
  frame(frame) {
    const now = performance.now();
    if (this.ends && now - this.ends.from > this.ends.after) {
      this.ends.after = Infinity;
      this.session.end();
      return;
    }
    const space = this.stage.renderer.xr.getReferenceSpace();
    const viewer = space && frame.getViewerPose(space);
    if (!viewer || this.session.visibilityState === "hidden") {  // tracking is lost: what was there stays, and is not seen
      this.counts.lost += 1;
      this.tell(frame, space, null, []);
      return;
    }
    this.counts.frames += 1;
    if (!this.placed) this.recentre(viewer.transform);
    this.stage.dim(this.light(now), viewer.transform.position);
    const { position, orientation } = viewer.transform;
    const eyes = new Vector3(position.x, position.y, position.z);
    const turn = new Quaternion(orientation.x, orientation.y, orientation.z, orientation.w);
    for (const panel of [this.spoken, this.standing]) panel.show(eyes, turn, now);
    let shown = 0;
    const seen = [null, null];
    for (const source of this.session.inputSources) {
      if (!source.hand) continue;
      const side = source.handedness === "left" ? 0 : 1, mesh = this.hands[side];
      seen[side] = this.drawHand(mesh, source.hand, frame, space);
      mesh.visible = Boolean(seen[side]);
      shown += mesh.visible;
    }
    this.board?.show(eyes, turn, this.rays(frame, space));
    this.tell(frame, space, viewer.transform, seen);
    this.counts.hands += shown > 0;
    for (const side of [0, 1]) if (!seen[side]) this.hands[side].visible = false;
  }

  /** Asks who wears it, on a board before her. */
  ask(board) {
    this.board = board;
    board.enter(this.stage.scene);
  }

  /** Of the left and the right hand, or its controller; null where there is none. */
  rays(frame, space) {
    const found = [null, null];
    for (const source of this.session.inputSources) found[source.handedness === "left" ? 0 : 1] = rayOf(source, frame, space);
    return found;
  }

  /** A pinch, or a trigger. */
  chosen(event) {
    const space = this.stage.renderer.xr.getReferenceSpace();
    this.board?.choose(rayOf(event.inputSource, event.frame, space), event.timeStamp || performance.now());
  }

  /** Sends what is seen, for when it holds. */
  tell(frame, space, viewer, hands) {
    if (!this.send || !this.placed) return;
    const { world } = this.stage, limbs = frame.body;
    world.updateWorldMatrix(true, false);
    const message = new Tracked(this.counts.sent, this.places, this.host(frame.predictedDisplayTime ?? performance.now()), world.matrixWorld.clone().invert());
    if (viewer) message.head(viewer);
    hands.forEach((places, side) => places && message.hand(side, places));
    if (limbs) {
      LIMBS.forEach((name, index) => {
        const pose = limbs.get(name) && frame.getPose(limbs.get(name), space);
        if (pose) message.limb(index, pose.transform.position);
      });
    }
    this.counts.sent += 1;
    this.send(message.bytes);
  }

  /** Puts the avatar at an arm's length before where the person looks, on her floor. */
  recentre({ position, orientation }) {
    this.placed = true;
    this.places += 1;
    if (this.space) {  // beside a lab's system: where it was registered, or its own, in which it is registered
      this.stage.placeSpace(this.space === "own" ? null : this.space);
      return;
    }
    const ahead = new Vector3(0, 0, -1).applyQuaternion(new Quaternion(orientation.x, orientation.y, orientation.z, orientation.w));
    const heading = Math.atan2(-ahead.x, -ahead.z);
    // Arms are as long as people are tall: so far apart their hands meet with bent elbows.
    const distance = Math.min(Math.max(0.5 * STAND_OFF * (1 + position.y / EYES), NEAREST), FURTHEST);
    this.stage.placeAvatar(new Vector3(position.x, 0, position.z), heading, distance);
  }

  hand() {
    const skin = new MeshStandardMaterial({ color: 0xd9a07c, roughness: 0.7 });
    const mesh = new InstancedMesh(new SphereGeometry(1, 12, 8), skin, JOINTS);
    mesh.bones = new InstancedMesh(new CylinderGeometry(1, 1, 1, 10), skin, BONES.length);
    mesh.add(mesh.bones);
    mesh.frustumCulled = mesh.bones.frustumCulled = false;
    mesh.visible = false;
    this.stage.scene.add(mesh);
    return mesh;
  }

  /** Places of all joints of a hand, or null: a hand that is not seen is not drawn. */
  drawHand(mesh, hand, frame, space) {
    const matrix = new Matrix4(), places = [], radii = [];
    let i = 0;
    for (const joint of hand.values()) {
      const pose = frame.getJointPose(joint, space);
      if (!pose) return null;
      const { position } = pose.transform, radius = pose.radius || 0.008;
      matrix.makeScale(radius, radius, radius).setPosition(position.x, position.y, position.z);
      mesh.setMatrixAt(i++, matrix);
      places.push(new Vector3(position.x, position.y, position.z));
      radii.push(radius);
    }
    BONES.forEach(([from, to], bone) => {
      const along = places[to].clone().sub(places[from]), length = along.length(), radius = 0.92 * Math.min(radii[from], radii[to]);
      const turn = new Quaternion().setFromUnitVectors(UP, along.divideScalar(length || 1));
      matrix.compose(places[from].clone().lerp(places[to], 0.5), turn, new Vector3(radius, length, radius));
      mesh.bones.setMatrixAt(bone, matrix);
    });
    mesh.bones.instanceMatrix.needsUpdate = true;
    mesh.instanceMatrix.needsUpdate = true;
    return places;
  }

  /** Palms have met: it is heard, and felt where there is a controller. */
  touch() {
    if (!this.session) return;
    const { sound } = this, clap = sound.createBufferSource(), volume = sound.createGain();
    const length = Math.round(0.09 * sound.sampleRate), buffer = sound.createBuffer(1, length, sound.sampleRate);
    const samples = buffer.getChannelData(0);
    for (let i = 0; i < length; i++) samples[i] = (Math.random() * 2 - 1) * Math.exp(-i / (0.012 * sound.sampleRate));
    clap.buffer = buffer;
    volume.gain.value = 0.5;
    clap.connect(volume).connect(sound.destination);
    clap.start();
    for (const source of this.session.inputSources) source.gamepad?.hapticActuators?.[0]?.pulse(...PULSE);
  }
}

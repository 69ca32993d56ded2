// The picture: avatar, person, arm and room; how well it is drawn, and what a headset changes of it.

import {
  Fog, GLTFLoader, Group, Matrix4, Mesh, MeshBasicMaterial, MeshLambertMaterial, PCFSoftShadowMap, DoubleSide, Quaternion, Scene,
  SphereGeometry, SRGBColorSpace, Vector3, WebGLRenderer,
} from "./three.js";
import { Eye } from "./camera.js";
import { Quality } from "./quality.js";
import { HIDDEN, ROOM, cutAway, isPlant, lights, shape } from "./room.js";
import { Signs } from "./signs.js";
import { Still } from "./still.js";
import { backdrop, planks } from "./textures.js";

const FAR_M = 5.5, SHARP_PIXELS = 1.2e6, FACE = /head|lids|lips|brows|hair|eye|iris|pupil/;
const ONE = new Vector3(1, 1, 1);

export class Stage {
  /** Throws where the browser has no WebGL. */
  constructor(canvas, behind) {
    const slow = drawnByProcessor();
    this.renderer = new WebGLRenderer({ canvas, antialias: !slow, alpha: true, powerPreference: "high-performance" });
    this.renderer.outputColorSpace = SRGBColorSpace;
    this.renderer.shadowMap.type = PCFSoftShadowMap;
    this.quality = new Quality(slow, window.devicePixelRatio || 1);
    this.fine = !slow;
    this.scene = new Scene();
    this.backdrop = backdrop();
    this.fog = slow ? null : new Fog(0xe4e0d8, 6, 16);
    this.place = new Group();  // where everything is before the person with a headset; else not moved
    this.world = new Group();  // z up in here, as in the messages
    this.world.rotation.x = -Math.PI / 2;
    this.signs = new Signs();
    this.world.add(this.signs);
    this.place.add(this.world);
    this.scene.add(this.place, ...lights(!slow));
    this.eye = new Eye(canvas);
    this.camera = this.eye.camera;
    this.camera.layers.enable(ROOM);
    this.still = new Still(behind);
    this.stands = new Vector3();  // the camera, in the world
    this.people = new Vector3(0.5, 0, 1);
    for (const list of ["bodies", "near", "room", "far", "hers", "arm"]) this[list] = [];
    this.apply();
    addEventListener("resize", () => this.resize());
  }

  /** Loads shapes and skins. */
  async load() {
    const [scene, skin] = await Promise.all([
      fetch("scene.json").then((answer) => answer.json()),
      new GLTFLoader().loadAsync("skin.glb"),
    ]);
    this.names = scene.bodies;
    this.palms = [scene.palms.avatar, scene.palms.person];
    skin.scene.traverse((node) => {
      if (!node.isMesh) return;
      node.castShadow = node.receiveShadow = true;
      node.frustumCulled = false;
      if (node.name.startsWith("skin_person_")) this.hers.push(node);
      (node.name.endsWith("_far") ? this.far : this.near).push(node);
      if (!this.fine) node.material = new MeshLambertMaterial({ color: node.material.color, fog: false });
    });
    this.bodies = scene.bodies.map((name) => skin.scene.getObjectByName(name) || this.part(name));
    for (const body of this.bodies) body.matrixAutoUpdate = false;
    this.place.add(skin.scene);
    this.skin = skin.scene;
    this.skin.visible = false;  // until there is a pose
    const floor = planks(this.fine ? 8 : 1);
    for (const geom of scene.geoms) this.add(geom, floor);
    if (this.arm.length) this.partner("arm");
    this.detail();
    this.hide();
    this.ready = true;
  }

  /** A body without a skin: of the servo arm. */
  part(name) {
    const part = new Group();
    part.name = name;
    this.arm.push(part);
    this.world.add(part);
    return part;
  }

  add(geom, floor) {
    const mesh = shape(geom, floor, this.fine);
    if (geom.body >= 0) {
      this.bodies[geom.body].add(mesh);
      if (geom.name.startsWith("person_")) this.hers.push(mesh);
      return;
    }
    mesh.layers.set(ROOM);
    this.world.add(mesh);
    this.room.push(mesh);
  }

  /** Who meets her: avatar, arm or both. */
  partner(name) {
    this.met = name;
    for (const part of this.arm) part.visible = name !== "avatar";
    const layer = name === "arm" ? HIDDEN : 0;
    this.skin.traverse((node) => { if (node.isMesh && /^(skin_)?avatar_/.test(node.name)) node.layers.set(layer); });
  }

  /** Puts every body where it is: 7 floats each. */
  pose(values) {
    if (!this.ready) return;
    const place = new Vector3(), turn = new Quaternion();
    this.bodies.forEach((body, i) => {
      const at = 7 * i;
      if (at >= values.length) return;
      place.fromArray(values, at);
      turn.set(values[at + 4], values[at + 5], values[at + 6], values[at + 3]);
      body.matrix.compose(place, turn, ONE);
      body.matrixWorldNeedsUpdate = true;
    });
    this.skin.visible = true;
    this.values = values;
    const stood = ["pelvis", "person_pelvis"].map((name) => values.subarray(7 * this.names.indexOf(name)));
    const soft = !this.renderer.shadowMap.enabled;
    this.signs.showBlots([soft && this.met !== "arm" && stood[0], soft && !this.immersed && stood[1]]);
    this.signs.showPalms(values, this.palms, this.met !== "arm");
  }

  /** Hers would float before the eyes of who wears a headset. */
  showMarkers(points, seen) {
    this.signs.markers.visible = !this.immersed;
    this.signs.showMarkers(points, seen);
  }

  showForecast(forecast) { this.signs.showForecast(forecast); }

  contact(where, now) { this.signs.contact(where, now); }

  view(name) {
    this.eye.look(name);
    this.hide();
  }

  /** Hers that is not seen: all of it in a headset, the face from behind which one looks, all but the hand in a mirror. */
  hide() {
    for (const mesh of this.hers) {
      const behind = { person: FACE.test(mesh.name), mirror: !mesh.name.includes("right_hand") }[this.eye.name];
      const gone = this.immersed || behind;
      mesh.layers.set(gone ? HIDDEN : 0);
    }
  }

  /** Coarse meshes where the figures are far, or the machine is slow. */
  detail() {
    const coarse = this.quality.now.coarse || this.camera.position.distanceTo(this.eye.orbit.target) > FAR_M;
    if (coarse === this.coarse) return;
    this.coarse = coarse;
    for (const mesh of this.near) mesh.visible = !coarse;
    for (const mesh of this.far) mesh.visible = coarse;
  }

  /** For a headset: her own body hidden; in passthrough the room, too. */
  immerse(passthrough) {
    this.immersed = true;
    this.passthrough = passthrough;
    this.hide();
    for (const mesh of this.room) mesh.visible = !passthrough;
  }

  /** Back to the window. */
  emerge() {
    this.immersed = this.passthrough = false;
    for (const mesh of this.room) mesh.visible = true;
    this.place.position.set(0, 0, 0);
    this.place.rotation.set(0, 0, 0);
    this.dim(1);
    this.view(this.eye.name);
    this.resize();
  }

  /** Comfortable beginnings: from dark to light, 0 to 1. */
  dim(light, eyes) {
    if (!this.veil) {
      const black = new MeshBasicMaterial({ color: 0x000000, transparent: true, side: DoubleSide, depthTest: false, fog: false });
      this.veil = new Mesh(new SphereGeometry(0.25, 16, 12), black);
      this.veil.renderOrder = 1000;
      this.scene.add(this.veil);
    }
    this.veil.visible = light < 1;
    this.veil.material.opacity = 1 - light;
    if (eyes) this.veil.position.set(eyes.x, eyes.y, eyes.z);
  }

  /** The avatar so far before a person at ``where`` (y up, on the floor) who faces ``heading`` about the vertical. */
  placeAvatar(where, heading, distance) {
    // In the world the avatar stands at the origin and faces +x; she is to stand at +x and look at it.
    this.place.rotation.set(0, heading - Math.PI / 2, 0);
    this.place.position.set(where.x - Math.sin(heading) * distance, 0, where.z - Math.cos(heading) * distance);
    this.place.updateMatrixWorld();
  }

  /** The headset's space (z up) where it lies in the world: ``space`` has a quaternion w, x, y, z, and m; null leaves it. */
  placeSpace(space) {
    const { place, world } = this, lies = new Matrix4();
    world.updateMatrix();
    const own = world.matrix.clone();
    if (space) {
      const [w, x, y, z] = space.rotation;
      lies.compose(new Vector3().fromArray(space.translation), new Quaternion(x, y, z, w), ONE);
    }
    own.clone().multiply(lies.invert()).multiply(own.invert()).decompose(place.position, place.quaternion, new Vector3());
    place.updateMatrixWorld();
  }

  draw(now) {
    const { eye, camera, renderer, scene } = this;
    this.detail();
    if (this.immersed) camera.updateMatrixWorld();
    else if (eye.fixed) eye.orbit.update();
    else if (this.values) {
      const [head, face] = ["person_head", "head"].map((name) => this.names.indexOf(name));
      if (eye.name === "mirror") eye.asInAMirror(this.values, head, this.world);
      else eye.throughHers(this.values, head, face, this.world);
    }
    this.signs.move(now, camera);
    this.world.worldToLocal(this.stands.copy(camera.position));
    if (!this.immersed) cutAway(this.room, this.stands);
    const still = this.quality.now.still && !this.immersed && this.still.ready(eye.pose, () => this.roomAlone());
    this.whole(!still);
    renderer.render(scene, camera);
  }

  /** All of it is drawn, or only what moves, on what lies behind. */
  whole(all) {
    const { scene, camera } = this;
    scene.background = all && !this.passthrough ? this.backdrop : null;
    scene.fog = this.passthrough ? null : this.fog;
    for (const mesh of this.room) {  // what may stand before the people is not left behind them
      const before = !all && isPlant(mesh) && mesh.position.distanceTo(this.stands) < this.people.distanceTo(this.stands);
      mesh.layers.set(before || this.immersed ? 0 : ROOM);  // a headset's eyes see 0, and 1 or 2 each: no other layer
    }
    if (all) camera.layers.enable(ROOM); else camera.layers.disable(ROOM);
  }

  /** Draws the room and nothing else, finely, and gives the canvas with it. */
  roomAlone() {
    const { renderer, scene, camera } = this, [width, height] = this.eye.size;
    const moving = [this.skin, this.signs, ...this.arm], shown = moving.map((one) => one.visible);
    this.whole(true);
    moving.forEach((one) => { one.visible = false; });
    renderer.setPixelRatio(width * height > SHARP_PIXELS ? 1 : 2);
    renderer.setSize(width, height, false);
    renderer.render(scene, camera);
    return { canvas: renderer.domElement, after: () => {
      moving.forEach((one, i) => { one.visible = shown[i]; });
      renderer.setPixelRatio(this.quality.now.ratio);
      renderer.setSize(width, height, false);
    } };
  }

  /** Better or plainer by the pictures a second that there were. */
  judge(rate) { if (this.quality.judge(rate)) this.apply(); }

  apply() {
    const { now } = this.quality, shadows = this.renderer.shadowMap.enabled;
    this.renderer.shadowMap.enabled = now.shadows;
    if (shadows !== now.shadows) this.scene.traverse((node) => { if (node.material) node.material.needsUpdate = true; });
    document.body.classList.toggle("plain", now.still);
    this.resize();
  }

  resize() {
    if (this.renderer.xr.isPresenting) return;  // the headset has its own size
    const { innerWidth: width, innerHeight: height } = window;
    this.renderer.setPixelRatio(this.quality.now.ratio);
    this.renderer.setSize(width, height, false);
    this.still.forget();
    this.eye.fit(width, height, this.free || { left: 0, right: 0, top: 0, bottom: 0 });
    if (this.fog) [this.fog.near, this.fog.far] = [6, 16].map((from) => from + Math.max(this.eye.away - 6, 0));
  }

  /** So many pixels at each side lie under panels. */
  keepClear(free) {
    this.free = free;
    this.resize();
  }
}

/** There is no graphics card, or the browser does not use it. */
function drawnByProcessor() {
  const gl = document.createElement("canvas").getContext("webgl2");
  const about = gl && gl.getExtension("WEBGL_debug_renderer_info");
  const name = about ? gl.getParameter(about.UNMASKED_RENDERER_WEBGL) : "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return /llvmpipe|softpipe|swiftshader|software|basic render/i.test(name);
}

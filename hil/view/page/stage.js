// The picture: room, avatar and person, markers, forecast, contact; and from where it is seen.

import {
  AmbientLight, BoxGeometry, BufferAttribute, BufferGeometry, CanvasTexture, CapsuleGeometry, CircleGeometry, Color,
  CylinderGeometry, DirectionalLight, DoubleSide, Fog, GLTFLoader, Group, HemisphereLight, InstancedMesh, Line,
  LineDashedMaterial, Matrix4, Mesh, MeshBasicMaterial, MeshLambertMaterial, MeshStandardMaterial, OrbitControls, PCFSoftShadowMap,
  PerspectiveCamera, PlaneGeometry, Quaternion, RepeatWrapping, RingGeometry, Scene, SphereGeometry, SRGBColorSpace,
  Vector3, WebGLRenderer,
} from "./three.js";

const FLASH_MS = 700, FAR_M = 4.6, MOST_MARKERS = 128, EYES = [0.09, 0, 0.09];
const GAZE = 0.02, CHEST = 1.32;  // share of the way in a picture; m
const VIEWS = {  // eye and what is looked at, in the world: z up, m
  orbit: [[1.55, -3.05, 1.62], [0.5, 0, 1.02]],
  side: [[0.55, -3.5, 1.25], [0.52, 0, 1.0]],
  palms: [[0.66, -1.35, 1.55], [0.5, 0, 1.28]],
};

export class Stage {
  /** Throws where the browser has no WebGL. */
  constructor(canvas) {
    const slow = drawnByProcessor();
    this.renderer = new WebGLRenderer({ canvas, antialias: !slow, powerPreference: "high-performance" });
    this.renderer.outputColorSpace = SRGBColorSpace;
    this.renderer.shadowMap.enabled = !slow;
    this.renderer.shadowMap.type = PCFSoftShadowMap;
    this.scene = new Scene();
    this.scene.background = backdrop();
    this.scene.fog = new Fog(0xe4e0d8, 6, 16);
    this.camera = new PerspectiveCamera(36, 1, 0.03, 40);
    this.place = new Group();  // where everything is before the person with a headset; else not moved
    this.scene.add(this.place);
    this.world = new Group();  // z up in here, as in the messages
    this.world.rotation.x = -Math.PI / 2;
    this.place.add(this.world);
    this.orbit = new OrbitControls(this.camera, canvas);
    Object.assign(this.orbit, { enableDamping: true, dampingFactor: 0.12, minDistance: 0.5, maxDistance: 7, maxPolarAngle: 1.62 });
    this.bodies = [];
    this.near = [];
    this.room = [];
    this.far = [];
    this.hers = [];
    this.plain = { shadows: !slow, coarse: slow, ratio: Math.min(window.devicePixelRatio || 1, slow ? 1 : 2) };
    document.body.classList.toggle("plain", slow);
    this.light();
    this.signs();
    this.view("orbit");
    this.resize();
    addEventListener("resize", () => this.resize());
  }

  light() {
    this.scene.add(new HemisphereLight(0xf6f4ef, 0xb9a78f, 1.35), new AmbientLight(0xffffff, 0.35));
    const key = new DirectionalLight(0xfff2df, 2.1);
    key.position.set(-0.9, 4.2, 2.6);
    key.target.position.set(0.5, 0.9, 0);
    key.castShadow = true;
    key.shadow.mapSize.set(2048, 2048);
    Object.assign(key.shadow.camera, { left: -1.6, right: 1.8, top: 1.6, bottom: -1.6, near: 1, far: 8 });
    key.shadow.bias = -0.0004;
    key.shadow.normalBias = 0.012;
    if (this.plain.coarse) { this.scene.add(key, key.target); return; }
    const rim = new DirectionalLight(0xcfe3ff, 0.7);
    rim.position.set(2.5, 2.2, -2.4);
    this.scene.add(key, key.target, rim);
  }

  /** What is no body: markers, palms, the line between them, the forecast, the flash. */
  signs() {
    const seen = new MeshStandardMaterial({ color: 0xf7f9f8, roughness: 0.35, emissive: 0x8fd0e8, emissiveIntensity: 0.35 });
    this.markers = new InstancedMesh(new SphereGeometry(0.007, 12, 8), seen, MOST_MARKERS);
    this.markers.count = 0;
    this.markers.frustumCulled = false;
    const glow = (colour, opacity) => new MeshBasicMaterial({ color: colour, transparent: true, opacity, depthWrite: false, side: DoubleSide });
    this.palmDiscs = [new Mesh(new CircleGeometry(0.034, 32), glow(0xd65f1f, 0.75)), new Mesh(new CircleGeometry(0.034, 32), glow(0x1f6f9c, 0.75))];
    const ends = new BufferGeometry();
    ends.setAttribute("position", new BufferAttribute(new Float32Array(6), 3));
    this.link = new Line(ends, new LineDashedMaterial({ color: 0x4a5655, dashSize: 0.015, gapSize: 0.012, transparent: true, opacity: 0.7 }));
    this.link.frustumCulled = false;
    this.forecast = new Mesh(new SphereGeometry(1, 28, 20), glow(0xd65f1f, 0.16));
    this.forecastDot = new Mesh(new SphereGeometry(0.009, 14, 10), glow(0xd65f1f, 0.9));
    this.flash = new Mesh(new RingGeometry(0.86, 1, 64), glow(0xffffff, 0));
    for (const sign of [this.markers, ...this.palmDiscs, this.link, this.forecast, this.forecastDot, this.flash]) {
      sign.visible = false;
      this.world.add(sign);
    }
    this.markers.visible = true;
    this.flashed = -Infinity;
    const blot = new MeshBasicMaterial({ map: blotTexture(), transparent: true, depthWrite: false });
    this.blots = [new Mesh(new PlaneGeometry(1, 0.8), blot), new Mesh(new PlaneGeometry(1, 0.8), blot)];
    for (const one of this.blots) { one.visible = false; this.world.add(one); }
  }

  /** Loads shapes and skins. */
  async load() {
    const [scene, skin] = await Promise.all([
      fetch("scene.json").then((answer) => answer.json()),
      new GLTFLoader().loadAsync("skin.glb"),
    ]);
    this.names = scene.bodies;
    this.palms = scene.palms;
    skin.scene.traverse((node) => {
      if (!node.isMesh) return;
      node.castShadow = node.receiveShadow = true;
      node.frustumCulled = false;
      if (node.name.startsWith("skin_person_")) this.hers.push(node);
      (node.name.endsWith("_far") ? this.far : this.near).push(node);
      if (this.plain.coarse) node.material = new MeshLambertMaterial({ color: node.material.color, fog: false });
    });
    this.detail();
    this.arm = [];
    this.bodies = scene.bodies.map((name) => skin.scene.getObjectByName(name) || this.part(name));
    for (const body of this.bodies) body.matrixAutoUpdate = false;
    this.place.add(skin.scene);
    this.skin = skin.scene;
    const floor = planks(this.plain.coarse ? 1 : 8);
    for (const geom of scene.geoms) this.add(geom, floor);
    if (this.arm.length) this.partner("arm");
    this.ready = true;
  }

  /** A body without a skin: of the servo arm. */
  part(name) {
    const part = new Group();
    part.name = name;
    part.visible = false;
    this.arm.push(part);
    this.world.add(part);
    return part;
  }

  /** Who meets her: avatar, arm or both. */
  partner(name) {
    this.met = name;
    for (const part of this.arm) part.visible = name !== "avatar";
    const shown = name !== "arm";
    this.skin.traverse((node) => { if (node.isMesh && /^(skin_)?avatar_/.test(node.name)) node.layers.set(shown ? 0 : 1); });
  }

  add(geom, floor) {
    const [a, b, c] = geom.size;
    const [red, green, blue] = geom.colour;
    const material = this.material(geom);
    material.color = new Color().setRGB(red, green, blue, SRGBColorSpace);
    const make = {
      plane: () => new PlaneGeometry(2 * a, 2 * b),
      box: () => new BoxGeometry(2 * a, 2 * b, 2 * c),
      sphere: () => new SphereGeometry(a, 20, 14),
      ellipsoid: () => new SphereGeometry(1, 28, 18).scale(a, b, c),
      cylinder: () => new CylinderGeometry(a, a, 2 * b, 48).rotateX(Math.PI / 2),
      capsule: () => new CapsuleGeometry(a, 2 * b, 8, 20).rotateX(Math.PI / 2),
    };
    if (geom.shape === "plane") { material.map = floor; material.color.set(0xffffff); }
    if (geom.ghost) Object.assign(material, { transparent: true, opacity: 0.28, depthWrite: false });
    const mesh = new Mesh(make[geom.shape](), material);
    mesh.name = geom.name;
    mesh.position.fromArray(geom.position);
    const [w, x, y, z] = geom.quaternion;
    mesh.quaternion.set(x, y, z, w);
    mesh.receiveShadow = true;
    mesh.castShadow = (geom.body >= 0 && !geom.ghost) || ["pot", "leaf"].some((part) => geom.name.startsWith(part));
    if (geom.body >= 0) {
      this.bodies[geom.body].add(mesh);
      if (geom.name.startsWith("person_")) this.hers.push(mesh);
    } else {
      this.world.add(mesh);
      this.room.push(mesh);
    }
  }

  /** What a processor draws is shaded no more than it must be: the room not at all. */
  material(geom) {
    if (!this.plain.coarse) return new MeshStandardMaterial({ roughness: 1 - 0.7 * geom.gloss, metalness: 0 });
    return geom.body < 0 ? new MeshBasicMaterial({ fog: false }) : new MeshLambertMaterial();
  }

  /** Puts every body where it is: 7 floats each. */
  pose(values) {
    if (!this.ready) return;
    const place = new Vector3(), turn = new Quaternion(), size = new Vector3(1, 1, 1);
    this.bodies.forEach((body, i) => {
      const at = 7 * i;
      if (at >= values.length) return;
      place.fromArray(values, at);
      turn.set(values[at + 4], values[at + 5], values[at + 6], values[at + 3]);
      body.matrix.compose(place, turn, size);
      body.matrixWorldNeedsUpdate = true;
    });
    this.skin.visible = true;
    this.values = values;
    ["pelvis", "person_pelvis"].forEach((name, i) => {  // something to stand on where there are no shadows
      const at = 7 * this.names.indexOf(name);
      this.blots[i].position.set(values[at], values[at + 1], 0.007);
      this.blots[i].visible = !this.plain.shadows && (i === 1 || this.met !== "arm");
    });
    this.showPalms(values);
  }

  showPalms(values) {
    const at = ["avatar", "person"].map((owner, i) => {
      const { body, position, quaternion } = this.palms[owner];
      const frame = new Matrix4().compose(
        new Vector3().fromArray(values, 7 * body),
        new Quaternion(values[7 * body + 4], values[7 * body + 5], values[7 * body + 6], values[7 * body + 3]), new Vector3(1, 1, 1),
      );
      const [w, x, y, z] = quaternion;
      frame.multiply(new Matrix4().compose(new Vector3().fromArray(position), new Quaternion(x, y, z, w), new Vector3(1, 1, 1)));
      const disc = this.palmDiscs[i];
      frame.decompose(disc.position, disc.quaternion, new Vector3());
      return disc.position;
    });
    const distance = at[0].distanceTo(at[1]);
    const near = distance < 0.6;
    const ends = this.link.geometry.attributes.position;
    at.forEach((point, i) => ends.setXYZ(i, point.x, point.y, point.z));
    ends.needsUpdate = true;
    this.link.computeLineDistances();
    this.link.visible = near && distance > 0.02;
    for (const disc of this.palmDiscs) disc.visible = near && distance > 0.012;
  }

  showMarkers(points, seen) {
    const matrix = new Matrix4();
    let shown = 0;
    for (let i = 0; i < seen.length && shown < MOST_MARKERS; i++) {
      if (!seen[i]) continue;
      matrix.makeTranslation(points[3 * i], points[3 * i + 1], points[3 * i + 2]);
      this.markers.setMatrixAt(shown++, matrix);
    }
    this.markers.count = shown;
    this.markers.instanceMatrix.needsUpdate = true;
  }

  /** The forecast of the contact: its place, and the half axes of its standard deviation (columns), m. */
  showForecast(forecast) {
    this.forecast.visible = this.forecastDot.visible = Boolean(forecast);
    if (!forecast) return;
    const [a, b, c] = forecast.axes, [x, y, z] = forecast.point;
    this.forecast.matrixAutoUpdate = false;
    this.forecast.matrix.set(a[0], b[0], c[0], x, a[1], b[1], c[1], y, a[2], b[2], c[2], z, 0, 0, 0, 1);
    this.forecast.matrixWorldNeedsUpdate = true;
    this.forecastDot.position.set(x, y, z);
  }

  /** Palms have met there. */
  contact(where, now) {
    this.flash.position.fromArray(where);
    this.flashed = now;
  }

  view(name) {
    this.seen = name;
    const preset = VIEWS[name];
    this.orbit.enabled = Boolean(preset);
    const inside = name === "person" || name === "mirror";
    // Before a screen she sees the hand that she raises, on the side where she raises it.
    for (const mesh of this.hers) mesh.layers.set(inside && !(name === "mirror" && mesh.name.includes("right_hand")) ? 1 : 0);
    this.gaze = null;
    this.camera.fov = inside ? 68 : 36;
    if (preset) {
      const [eye, goal] = preset.map(([x, y, z]) => new Vector3(x, z, -y));
      const away = this.camera.aspect < 1 ? Math.min(1 / this.camera.aspect, 1.9) : 1;
      this.camera.up.set(0, 1, 0);
      this.camera.position.copy(goal).addScaledVector(eye.sub(goal), away);
      this.orbit.target.copy(goal);
      this.orbit.update();
    }
    this.camera.updateProjectionMatrix();
  }

  /** The camera between her eyes, smoothly. */
  lookThroughHerEyes() {
    const head = this.names.indexOf("person_head");
    if (head < 0 || !this.values) return;
    const at = 7 * head, v = this.values;
    const turn = new Quaternion(v[at + 4], v[at + 5], v[at + 6], v[at + 3]);
    const eye = new Vector3(...EYES).applyQuaternion(turn).add(new Vector3().fromArray(v, at));
    const ahead = new Vector3(1, 0, -0.12).applyQuaternion(turn).add(eye);
    this.world.localToWorld(eye);
    this.world.localToWorld(ahead);
    this.camera.position.copy(eye);
    this.camera.up.set(0, 1, 0);
    this.camera.lookAt(ahead);
  }

  /** From where her head is, in the long run, to the avatar: what a webcam says of depth would shake the picture. */
  lookAsInAMirror() {
    const head = this.names.indexOf("person_head");
    if (head < 0 || !this.values) return;
    const eye = this.world.localToWorld(new Vector3().fromArray(this.values, 7 * head));
    this.gaze = this.gaze ? this.gaze.lerp(eye, GAZE) : eye;
    this.camera.position.copy(this.gaze);
    this.camera.up.set(0, 1, 0);
    this.camera.lookAt(this.world.localToWorld(new Vector3(0, 0, CHEST)));
  }

  /** Coarse meshes where the figures are far, or the machine is slow. */
  detail() {
    const coarse = this.plain.coarse || this.camera.position.distanceTo(this.orbit.target) > FAR_M;
    if (coarse === this.coarse) return;
    this.coarse = coarse;
    for (const mesh of this.near) mesh.visible = !coarse;
    for (const mesh of this.far) mesh.visible = coarse;
  }

  /** For a headset: her own body hidden; in passthrough the room, too. */
  immerse(passthrough) {
    this.immersed = true;
    for (const mesh of this.hers) mesh.layers.set(1);
    this.kept = { background: this.scene.background, fog: this.scene.fog };
    if (passthrough) {
      this.scene.background = this.scene.fog = null;
      for (const mesh of this.room) mesh.visible = false;
    }
  }

  /** Back to the window. */
  emerge() {
    this.immersed = false;
    Object.assign(this.scene, this.kept);
    for (const mesh of this.room) mesh.visible = true;
    this.place.position.set(0, 0, 0);
    this.place.rotation.set(0, 0, 0);
    this.dim(1);
    this.view(this.seen);
    this.resize();
  }

  /** Comfortable beginnings: from dark to light, 0 to 1. */
  dim(light, eyes) {
    if (!this.veil) {
      this.veil = new Mesh(new SphereGeometry(0.25, 16, 12), new MeshBasicMaterial({ color: 0x000000, transparent: true, side: DoubleSide, depthTest: false, fog: false }));
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

  draw(now) {
    this.detail();
    if (this.immersed) this.camera.updateMatrixWorld();
    else if (this.seen === "person") this.lookThroughHerEyes();
    else if (this.seen === "mirror") this.lookAsInAMirror(); else this.orbit.update();
    const share = (now - this.flashed) / FLASH_MS;
    this.flash.visible = share >= 0 && share < 1;
    if (this.flash.visible) {
      this.flash.scale.setScalar(0.03 + 0.2 * (1 - (1 - share) ** 3));
      this.flash.material.opacity = 0.95 * (1 - share) ** 1.5;
      this.world.updateMatrixWorld();
      const facing = new Quaternion();
      this.world.getWorldQuaternion(facing).invert().multiply(this.camera.quaternion);
      this.flash.quaternion.copy(facing);
    }
    this.renderer.render(this.scene, this.camera);
  }

  /** Plainer, where the machine cannot draw this often enough: first fewer pixels, then no shadows, then fewer still. */
  simplify() {
    const { plain } = this;
    if (plain.ratio > 1) plain.ratio = 1;
    else if (plain.shadows) plain.shadows = this.renderer.shadowMap.enabled = false;
    else if (!plain.coarse) plain.coarse = true;
    else if (plain.ratio > 0.6) plain.ratio = 0.6;
    else return false;
    document.body.classList.add("plain");
    if (!plain.shadows) this.scene.traverse((node) => { if (node.material) node.material.needsUpdate = true; });
    this.resize();
    return true;
  }

  resize() {
    if (this.renderer.xr.isPresenting) return;  // the headset has its own size
    const { innerWidth: width, innerHeight: height } = window;
    this.renderer.setPixelRatio(this.plain.ratio);
    this.renderer.setSize(width, height, false);
    const turned = (this.camera.aspect < 1) !== (width < height);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    if (turned) this.view(this.seen);
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

/** A soft gradient behind everything. */
function backdrop() {
  const canvas = document.createElement("canvas");
  canvas.width = 4;
  canvas.height = 256;
  const context = canvas.getContext("2d"), fill = context.createLinearGradient(0, 0, 0, 256);
  fill.addColorStop(0, "#d9e0e2");
  fill.addColorStop(0.6, "#efeae1");
  fill.addColorStop(1, "#d9cfbf");
  context.fillStyle = fill;
  context.fillRect(0, 0, 4, 256);
  const texture = new CanvasTexture(canvas);
  texture.colorSpace = SRGBColorSpace;
  return texture;
}

/** A soft dark spot, in place of a shadow. */
function blotTexture() {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 128;
  const context = canvas.getContext("2d"), fill = context.createRadialGradient(64, 64, 0, 64, 64, 64);
  fill.addColorStop(0, "rgba(25,30,35,0.5)");
  fill.addColorStop(0.5, "rgba(25,30,35,0.22)");
  fill.addColorStop(1, "rgba(25,30,35,0)");
  context.fillStyle = fill;
  context.fillRect(0, 0, 128, 128);
  return new CanvasTexture(canvas);
}

/** Floor boards. */
function planks(anisotropy) {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 512;
  const context = canvas.getContext("2d");
  for (let row = 0; row < 8; row++) {
    const shift = (row * 173) % 512;
    for (const start of [shift - 512, shift]) {
      const light = 62 + ((row * 37 + (start < shift ? 11 : 0)) % 6);
      context.fillStyle = `hsl(31 30% ${light}%)`;
      context.fillRect(start, row * 64, 512, 64);
      context.fillStyle = "rgba(70,45,20,0.22)";
      context.fillRect(start, row * 64, 2, 64);
    }
    context.fillRect(0, row * 64, 512, 2);
  }
  const texture = new CanvasTexture(canvas);
  texture.colorSpace = SRGBColorSpace;
  texture.wrapS = texture.wrapT = RepeatWrapping;
  texture.repeat.set(4, 8);
  texture.anisotropy = anisotropy;
  return texture;
}

// Shapes that are no skins, and the light: the room, eyes, the servo arm.

import {
  AmbientLight, BoxGeometry, CapsuleGeometry, Color, CylinderGeometry, DirectionalLight, HemisphereLight, Mesh, MeshBasicMaterial,
  MeshLambertMaterial, MeshStandardMaterial, PlaneGeometry, SphereGeometry, SRGBColorSpace,
} from "./three.js";
import { wallLight } from "./textures.js";

export const HIDDEN = 5, ROOM = 6;
/* Layers; 1 and 2 are a headset's left and right eye. */

const PLANT = ["pot", "leaf"];

/** Light of all that is lit; the key throws shadows where they are on. A processor gets along with the key. */
export function lights(fine) {
  const key = new DirectionalLight(0xfff0da, fine ? 1.9 : 2.2);
  key.position.set(-0.9, 4.2, 2.6);
  key.target.position.set(0.5, 0.9, 0);
  key.castShadow = true;
  key.shadow.mapSize.set(2048, 2048);
  Object.assign(key.shadow.camera, { left: -1.6, right: 1.8, top: 1.6, bottom: -1.6, near: 1, far: 8 });
  key.shadow.bias = -0.0004;
  key.shadow.normalBias = 0.012;
  key.shadow.radius = 5;
  const all = [new HemisphereLight(0xf6f4ef, 0xb9a78f, 1.35), new AmbientLight(0xffffff, fine ? 0.5 : 0.35), key, key.target];
  if (fine) {  // from behind, and onto the walls
    for (const [colour, strength, place] of [[0xcfe3ff, 0.8, [2.5, 2.2, -2.4]], [0xfff6e8, 1.2, [3.2, 1.6, 3.2]]]) {
      const more = new DirectionalLight(colour, strength);
      more.position.set(...place);
      all.push(more);
    }
  }
  for (const one of all) one.layers.enableAll();
  return all;
}

function geometry({ shape, size: [a, b, c] }, fine) {
  switch (shape) {
    case "plane": return new PlaneGeometry(2 * a, 2 * b);
    case "box": return new BoxGeometry(2 * a, 2 * b, 2 * c);
    case "sphere": return new SphereGeometry(a, fine ? 20 : 10, fine ? 14 : 7);
    case "ellipsoid": return new SphereGeometry(1, fine ? 28 : 14, fine ? 18 : 10).scale(a, b, c);
    case "cylinder": return new CylinderGeometry(a, a, 2 * b, 48).rotateX(Math.PI / 2);
    default: return new CapsuleGeometry(a, 2 * b, 8, 20).rotateX(Math.PI / 2);
  }
}

/** A shape of the room or of a body; where a processor draws, the room has its light painted on. */
export function shape(geom, floor, fine) {
  const inRoom = geom.body < 0, plant = PLANT.some((part) => geom.name.startsWith(part));
  const material = fine ? new MeshStandardMaterial({ roughness: 1 - 0.7 * geom.gloss, metalness: 0 })
    : inRoom && !plant ? new MeshBasicMaterial({ fog: false }) : new MeshLambertMaterial({ fog: false });
  material.color = new Color().setRGB(...geom.colour.slice(0, 3), SRGBColorSpace);
  if (geom.shape === "plane") { material.map = floor; material.color.set(0xffffff); }
  if (geom.name.startsWith("wall")) material.map = wallLight();
  if (geom.ghost) Object.assign(material, { transparent: true, opacity: 0.28, depthWrite: false });
  const mesh = new Mesh(geometry(geom, fine), material), [w, x, y, z] = geom.quaternion;
  mesh.name = geom.name;
  mesh.position.fromArray(geom.position);
  mesh.quaternion.set(x, y, z, w);
  mesh.receiveShadow = true;
  mesh.castShadow = (!inRoom && !geom.ghost) || plant;
  return mesh;
}

/** Walls, and what hangs on them, are left out where the camera is behind them (its place in the world, z up, m). */
export function cutAway(room, eye) {
  const walls = Object.fromEntries(["back", "left"].map((side) => [side, room.find((mesh) => mesh.name === `wall_${side}`)]));
  const seen = { back: !walls.back || eye.y < walls.back.position.y, left: !walls.left || eye.x > walls.left.position.x };
  for (const mesh of room) {
    if (/_left$/.test(mesh.name)) mesh.visible = seen.left;
    else if (/_back$|^frame|^picture/.test(mesh.name)) mesh.visible = seen.back;
  }
}

/** Parts of the room that stand between the camera and the people at some sides. */
export const isPlant = (mesh) => PLANT.some((part) => mesh.name.startsWith(part));

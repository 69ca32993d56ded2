// What a headset sends of its wearer: head and hands in the world (z up), and for when; see wire/headset.py.

import { Matrix4, Quaternion, Vector3 } from "./three.js";

const KIND = 2, VERSION = 1, HEAD = 24, JOINTS = 25, FLOATS = 7 + 2 * JOINTS * 3 + 4 * 3;
export const LIMBS = ["left-arm-upper", "left-arm-lower", "right-arm-upper", "right-arm-lower"];  // shoulders and elbows

/** One message, filled in by those who see something; what nobody puts in is not seen. */
export class Tracked {
  /** @param {Matrix4} world from the headset's space to the world */
  constructor(number, place, holds, world) {
    this.bytes = new ArrayBuffer(HEAD + 4 * FLOATS);
    this.view = new DataView(this.bytes);
    this.floats = new Float32Array(this.bytes, HEAD);
    this.world = world;
    this.view.setUint8(0, KIND);
    this.view.setUint8(1, VERSION);
    this.view.setUint8(3, place & 255);
    this.view.setUint32(4, number >>> 0, true);
    this.view.setFloat64(8, holds, true);
  }

  flag(bit) { this.view.setUint8(2, this.view.getUint8(2) | (1 << bit)); }

  point(place, at) { new Vector3(place.x, place.y, place.z).applyMatrix4(this.world).toArray(this.floats, at); }

  head({ position, orientation }) {
    this.point(position, 0);
    const { x, y, z, w } = orientation;
    new Quaternion().setFromRotationMatrix(new Matrix4().extractRotation(this.world)).multiply(new Quaternion(x, y, z, w)).normalize().toArray(this.floats, 3);
    this.flag(0);
  }

  /** All joints of a hand (0 left, 1 right), in the order of XRHand. */
  hand(side, places) {
    places.forEach((place, joint) => this.point(place, 7 + 3 * (JOINTS * side + joint)));
    this.view.setUint32(16 + 4 * side, 2 ** places.length - 1, true);
  }

  limb(index, place) {
    this.point(place, 7 + 6 * JOINTS + 3 * index);
    this.flag(1 + index);
  }
}

// What is painted rather than modelled: boards, light on walls, soft spots in place of shadows.

import { CanvasTexture, RepeatWrapping, SRGBColorSpace } from "./three.js";

function painted(width, height, paint) {
  const canvas = document.createElement("canvas");
  canvas.width = width;
  canvas.height = height;
  paint(canvas.getContext("2d"));
  const texture = new CanvasTexture(canvas);
  texture.colorSpace = SRGBColorSpace;
  return texture;
}

function fade(context, box, gradient, stops) {
  for (const [at, colour] of stops) gradient.addColorStop(at, colour);
  context.fillStyle = gradient;
  context.fillRect(...box);
}

/** Behind everything. */
export function backdrop() {
  return painted(4, 256, (context) => {
    fade(context, [0, 0, 4, 256], context.createLinearGradient(0, 0, 0, 256), [[0, "#dfe4e4"], [0.6, "#efeae1"], [1, "#d9cfbf"]]);
  });
}

/** Light from above and from a window on a wall: multiplies its colour. */
export function wallLight() {
  return painted(128, 64, (context) => {
    fade(context, [0, 0, 128, 64], context.createLinearGradient(0, 0, 0, 64), [[0, "#fbfbfa"], [0.4, "#ffffff"], [0.85, "#f4f1ee"], [1, "#e2ddd8"]]);
    fade(context, [0, 0, 128, 64], context.createRadialGradient(62, 24, 4, 62, 28, 84), [[0, "rgba(255,248,232,0.5)"], [1, "rgba(112,98,84,0.13)"]]);
  });
}

/** A soft dark spot. */
export function blot() {
  const texture = painted(128, 128, (context) => {
    fade(context, [0, 0, 128, 128], context.createRadialGradient(64, 64, 0, 64, 64, 64), [
      [0, "rgba(24,22,26,0.62)"], [0.35, "rgba(24,22,26,0.34)"], [0.7, "rgba(24,22,26,0.09)"], [1, "rgba(24,22,26,0)"],
    ]);
  });
  return texture;
}

/** Floor boards. */
export function planks(anisotropy) {
  const texture = painted(1024, 512, (context) => {
    for (let row = 0; row < 8; row++) {
      const shift = (row * 377) % 1024;
      for (const start of [shift - 1024, shift]) {
        const tone = (row * 37 + (start < shift ? 11 : 0)) % 6;
        context.fillStyle = `hsl(${29 + (tone % 3)} 33% ${61 + tone}%)`;
        context.fillRect(start, row * 64, 1024, 64);
        for (let line = 0; line < 7; line++) {  // grain
          context.fillStyle = `rgba(96,62,30,${0.03 + 0.02 * ((row + line * 3) % 3)})`;
          context.fillRect(start, row * 64 + 4 + ((line * 29 + row * 13) % 58), 1024, 1 + (line % 2));
        }
        context.fillStyle = "rgba(70,45,20,0.28)";
        context.fillRect(start, row * 64, 2, 64);
      }
      context.fillRect(0, row * 64, 1024, 2);
    }
  });
  texture.wrapS = texture.wrapT = RepeatWrapping;
  texture.repeat.set(2, 8);
  texture.anisotropy = anisotropy;
  return texture;
}

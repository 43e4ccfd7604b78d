/** A drone's name in the scene, always upright and of one size on the screen: who is who in a team. */
import { CanvasTexture, SRGBColorSpace, Sprite, SpriteMaterial } from "three";

const [WIDE, TALL] = [384, 64]; // pixels of the drawing
const SHARE = 0.032; // of the distance to the camera, its height
const ABOVE = 0.09; // m over a drone of true size
const PALE = 0.55; // how opaque the name of a drone that is down is

export class Label {
  /** `colour`: of the side, as CSS writes it. */
  constructor(name, colour) {
    this.pictures = [name, `${name}, down`].map((text) => drawn(text, colour));
    const options = { transparent: true, depthTest: false, depthWrite: false };
    this.sprite = new Sprite(new SpriteMaterial({ ...options, map: this.pictures[0] }));
    this.sprite.renderOrder = 6;
  }

  /** `scale`: of the drone; `far`: m to the camera. */
  place([x, y, z], scale, far, down) {
    const tall = SHARE * far;
    this.sprite.position.set(x, y, z + ABOVE * scale);
    this.sprite.scale.set((tall * WIDE) / TALL, tall, 1);
    this.sprite.material.map = this.pictures[down ? 1 : 0];
    this.sprite.material.opacity = down ? PALE : 1;
  }

  dispose() {
    for (const picture of this.pictures) picture.dispose();
  }
}

function drawn(text, colour) {
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [WIDE, TALL];
  const picture = new CanvasTexture(canvas);
  picture.colorSpace = SRGBColorSpace;
  const pen = canvas.getContext("2d");
  if (pen === null) return picture;
  pen.font = "600 34px system-ui, sans-serif";
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  pen.lineWidth = 7;
  pen.lineJoin = "round";
  pen.strokeStyle = "rgba(12, 17, 24, 0.85)";
  pen.fillStyle = "#ffffff";
  pen.strokeText(text, WIDE / 2, TALL / 2);
  pen.fillText(text, WIDE / 2, TALL / 2);
  pen.fillStyle = colour;
  pen.fillRect(WIDE / 2 - 40, TALL - 8, 80, 5);
  return picture;
}

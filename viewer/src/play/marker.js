/** Labels over the picture: how far the other drone and the target are, and which way if unseen. */
import { Vector3 } from "three";
import { distance } from "../flight.js";
import { write } from "../dom.js";

const EDGE = 34; // pixels that a label keeps from the upper and lower border
const BORDER = 6; // from the others
const ABOVE = 30; // pixels over what it names

/** Put a label where `there` is on the screen, or at the border on the way to it. */
export function place({ box, arrow, label }, camera, own, there, canvas, name) {
  const { clientWidth: width, clientHeight: height } = canvas;
  const seen = new Vector3(...there).applyMatrix4(camera.matrixWorldInverse);
  const behind = seen.z > -camera.near;
  const { x, y } = seen.applyMatrix4(camera.projectionMatrix);
  let [right, down] = [(width * (1 + x)) / 2, (height * (1 - y)) / 2];
  if (behind) [right, down] = [width - right, height - down + height]; // below the picture
  write(label, `${name} ${distance(own, there).toFixed(1)}\u00a0m`);
  box.hidden = false;
  const side = box.offsetWidth / 2 + BORDER;
  const across = Math.min(Math.max(right, side), width - side);
  const along = Math.min(Math.max(down - ABOVE, EDGE), height - EDGE);
  const outside = behind || Math.abs(x) > 1 || Math.abs(y) > 1;
  box.dataset.role = name;
  box.classList.toggle("outside", outside);
  box.style.left = `${across}px`;
  box.style.top = `${along}px`;
  arrow.style.rotate = `${Math.atan2(down - height / 2, right - width / 2) + Math.PI / 2}rad`;
}

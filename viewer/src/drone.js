/**
 * A Crazyflie from primitives, as in `mjcf/crazyflie.xml`: sizes in m, nose along +x, up +z.
 * MuJoCo gives half sizes, three.js wants whole ones. The arms have the team's colour.
 */
import {
  BoxGeometry,
  BufferAttribute,
  CircleGeometry,
  Color,
  CylinderGeometry,
  DoubleSide,
  Group,
  Mesh,
  MeshLambertMaterial,
  RingGeometry,
  SphereGeometry,
} from "three";
import { mergeGeometries } from "three/addons/utils/BufferGeometryUtils.js";

export const ENLARGEMENT = 5; // of the drones, unless true sizes are wanted: 9 cm are lost in 10 m

const CARBON = "#434b54";
const STEEL = "#b4b9c0";
const BATTERY = "#dcdee2";
const PINS = "#d9b04a";
const MOTORS = [
  [0.0325, -0.0325],
  [-0.0325, -0.0325],
  [-0.0325, 0.0325],
  [0.0325, 0.0325],
];
const ROTOR_RADIUS = 0.023;
const ROTOR_HEIGHT = 0.0145;

/** What all drones of one colour share: geometries and materials. */
export class Hangar {
  constructor(colour) {
    this.frame = mergeGeometries(frameParts(colour));
    this.blades = mergeGeometries([0, Math.PI].map((turn) => blade(turn)));
    this.disc = new CircleGeometry(ROTOR_RADIUS, 28);
    this.halo = new RingGeometry(0.0655, 0.072, 48);
    const vertexColors = true;
    this.solid = new MeshLambertMaterial({
      vertexColors,
      emissive: "#ffffff",
      emissiveIntensity: 0.07,
    });
    this.blade = new MeshLambertMaterial({
      color: "#f3f6fa",
      side: DoubleSide,
      emissive: "#666c74",
    });
    const see = { transparent: true, depthWrite: false, side: DoubleSide };
    this.blur = new MeshLambertMaterial({
      ...see,
      color: colour,
      opacity: 0.42,
      emissive: colour,
      emissiveIntensity: 0.35,
    });
    this.team = new MeshLambertMaterial({ ...see, color: colour, opacity: 0.8, emissive: colour });
  }

  build() {
    return new Drone(this);
  }

  dispose() {
    for (const part of Object.values(this)) part.dispose();
  }
}

class Drone {
  constructor(hangar) {
    this.group = new Group();
    const halo = new Mesh(hangar.halo, hangar.team);
    halo.position.z = -0.003;
    this.group.add(new Mesh(hangar.frame, hangar.solid), halo);
    this.rotors = MOTORS.map(([x, y]) => {
      const rotor = new Mesh(hangar.blades, hangar.blade);
      const disc = new Mesh(hangar.disc, hangar.blur);
      rotor.position.set(x, y, ROTOR_HEIGHT);
      disc.position.set(x, y, ROTOR_HEIGHT + 0.0004);
      this.group.add(rotor, disc);
      return { rotor, disc };
    });
  }

  /** `turned`: rad that the rotors have turned since the start; `running`: whether they do. */
  place(position, attitude, scale, turned, running) {
    this.group.position.fromArray(position);
    this.group.quaternion.fromArray(attitude);
    this.group.scale.setScalar(scale);
    this.rotors.forEach(({ rotor, disc }, index) => {
      rotor.rotation.z = (index % 2 ? -turned : turned) + index;
      disc.visible = running;
    });
  }
}

function frameParts(colour) {
  const parts = [
    at(box(0.029, 0.027, 0.0018, CARBON), 0, 0, 0),
    at(box(0.021, 0.021, 0.0072, BATTERY), 0, 0, 0.0055),
    at(box(0.02, 0.0024, 0.006, PINS), 0, 0.0115, 0.0035),
    at(box(0.02, 0.0024, 0.006, PINS), 0, -0.0115, 0.0035),
    at(painted(new SphereGeometry(1, 20, 12).scale(0.02, 0.012, 0.008), colour), 0, 0, 0.0115),
    at(
      painted(new SphereGeometry(1, 10, 8).scale(0.004, 0.004, 0.003), "#ffffff"),
      0.017,
      0,
      0.0125,
    ),
  ];
  for (const [x, y] of MOTORS) {
    const arm = box(0.046, 0.007, 0.0018, colour).rotateZ(Math.atan2(y, x));
    const motor = painted(
      new CylinderGeometry(0.0035, 0.0035, 0.019, 14).rotateX(Math.PI / 2),
      STEEL,
    );
    parts.push(at(arm, x / 2, y / 2, 0), at(motor, x, y, 0.004));
  }
  return parts;
}

function blade(turn) {
  const shape = new BoxGeometry(ROTOR_RADIUS * 0.96, 0.0042, 0.0006);
  return at(shape.rotateX(0.25), ROTOR_RADIUS / 2, 0, 0).rotateZ(turn);
}

function box(length, width, height, colour) {
  return painted(new BoxGeometry(length, width, height), colour);
}

function at(geometry, x, y, z) {
  return geometry.translate(x, y, z);
}

/** The same shape with its colour in every corner, so that many parts are drawn at once. */
function painted(geometry, colour) {
  const { r, g, b } = new Color(colour);
  const count = geometry.getAttribute("position").count;
  const colours = Float32Array.from({ length: 3 * count }, (_, i) => [r, g, b][i % 3]);
  return geometry.setAttribute("color", new BufferAttribute(colours, 3));
}

/** What is drawn around the drones: the rules' radii, plumb lines, the target, events. */
import {
  CircleGeometry,
  Color,
  CylinderGeometry,
  Group,
  Mesh,
  MeshBasicMaterial,
  RingGeometry,
  ShaderMaterial,
  SphereGeometry,
} from "three";

const SPHERE = new SphereGeometry(1, 40, 24);
const DOT = new CircleGeometry(1, 32);
const POLE = new CylinderGeometry(1, 1, 1, 6).rotateX(Math.PI / 2);
const THIN = 0.001; // of the distance, the radius of a plumb line
const FOOT = new RingGeometry(0.94, 1, 56);

const BUBBLE_VERTEX = `
varying vec3 vNormal;
varying vec3 vView;
void main() {
  vec4 view = modelViewMatrix * vec4(position, 1.0);
  vNormal = normalize(normalMatrix * normal);
  vView = normalize(-view.xyz);
  gl_Position = projectionMatrix * view;
}`;

const BUBBLE_FRAGMENT = `
uniform vec3 colour;
uniform float base;
uniform float rim;
varying vec3 vNormal;
varying vec3 vView;
void main() {
  float edge = 1.0 - abs(dot(normalize(vNormal), normalize(vView)));
  gl_FragColor = vec4(colour, base + rim * pow(edge, 2.6));
  #include <colorspace_fragment>
}`;

/** A translucent sphere with a brighter rim. */
export function bubble(colour, radius, base = 0.05, rim = 0.5) {
  const uniforms = { colour: { value: colour }, base: { value: base }, rim: { value: rim } };
  const shaders = { vertexShader: BUBBLE_VERTEX, fragmentShader: BUBBLE_FRAGMENT };
  const material = new ShaderMaterial({
    uniforms,
    ...shaders,
    transparent: true,
    depthWrite: false,
  });
  const mesh = new Mesh(SPHERE, material);
  mesh.scale.setScalar(radius);
  mesh.renderOrder = 4;
  return mesh;
}

/** A line from a drone to the floor, and its shadow there. */
export class Plumb {
  constructor(colour) {
    const see = { transparent: true, depthWrite: false };
    this.line = new Mesh(POLE, new MeshBasicMaterial({ ...see, color: colour, opacity: 0.55 }));
    this.shadow = new Mesh(DOT, new MeshBasicMaterial({ ...see, color: "#000000", opacity: 0.3 }));
    this.foot = new Mesh(DOT, new MeshBasicMaterial({ ...see, color: colour, opacity: 0.9 }));
    this.meshes = [this.shadow, this.foot, this.line];
    for (const mesh of this.meshes) mesh.renderOrder = 2;
  }

  /** `scale`: of the drone; `far`: m to the camera, so that the line keeps its width. */
  place([x, y, z], scale, far) {
    const height = Math.max(z, 0.001);
    this.line.position.set(x, y, height / 2);
    this.line.scale.set(THIN * far, THIN * far, height);
    this.shadow.position.set(x, y, 0.004);
    this.shadow.scale.setScalar(0.075 * scale * (1 + 0.25 * height));
    this.shadow.material.opacity = 0.32 / (1 + 0.5 * height);
    this.foot.position.set(x, y, 0.008);
    this.foot.scale.setScalar(0.045);
  }
}

/** The target: a core, the radius that counts, a pole and a ring on the floor. */
export function targetMark(colour, position, radius) {
  const group = new Group();
  const core = new Mesh(SPHERE, new MeshBasicMaterial({ color: colour }));
  core.scale.setScalar(0.09);
  const see = { color: colour, transparent: true, depthWrite: false };
  const pole = new Mesh(POLE, new MeshBasicMaterial({ ...see, opacity: 0.6 }));
  pole.scale.set(0.012, 0.012, Math.max(position[2], 0.001));
  pole.position.z = -position[2] / 2;
  const ring = new Mesh(FOOT, new MeshBasicMaterial({ ...see, opacity: 0.75 }));
  ring.scale.setScalar(radius);
  const disc = new Mesh(DOT, new MeshBasicMaterial({ ...see, opacity: 0.12 }));
  disc.scale.setScalar(radius);
  ring.position.z = 0.007 - position[2];
  disc.position.z = 0.005 - position[2];
  ring.renderOrder = disc.renderOrder = pole.renderOrder = 2;
  group.add(core, pole, ring, disc, bubble(colour, radius, 0.07, 0.55));
  group.position.fromArray(position);
  return group;
}

/** A shell that grows and fades after an event, and a ring on the floor that stays. */
export class Pulse {
  constructor(event, colour) {
    this.event = event;
    this.shell = bubble(colour, 1, 0.1, 1);
    const flash = new MeshBasicMaterial({ color: colour, transparent: true, depthWrite: false });
    flash.color.lerp(new Color("#ffffff"), 0.6);
    this.flash = new Mesh(SPHERE, flash);
    const stays = { color: colour, transparent: true, depthWrite: false, opacity: 0.9 };
    this.ring = new Mesh(FOOT, new MeshBasicMaterial(stays));
    this.meshes = [this.shell, this.flash, this.ring];
    const [x, y, z] = event.place;
    for (const mesh of [this.shell, this.flash]) mesh.position.set(x, y, z);
    this.ring.position.set(x, y, 0.009);
    this.ring.scale.setScalar(0.28);
    this.ring.renderOrder = 2;
    this.flash.renderOrder = 5;
  }

  /** `fade`: s that the shell takes. */
  show(time, fade) {
    const share = (time - this.event.time) / fade;
    const fresh = share >= -1e-6 && share < 1;
    this.shell.visible = this.flash.visible = fresh;
    this.ring.visible = share >= -1e-6;
    if (!fresh) return;
    const grown = 1 - (1 - share) ** 3;
    this.shell.scale.setScalar(0.15 + 1.1 * grown);
    this.shell.material.uniforms.base.value = 0.16 * (1 - share);
    this.shell.material.uniforms.rim.value = 1.2 * (1 - share);
    this.flash.scale.setScalar(0.02 + 0.24 * (1 - share));
    this.flash.material.opacity = 0.9 * (1 - share);
  }
}

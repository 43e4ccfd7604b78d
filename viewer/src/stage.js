/** One WebGL context that draws every visible fight into its own part of one canvas. */
import { Color, Vector2, WebGLRenderer } from "three";
import { Hangar } from "./drone.js";
import { Model, sights } from "./model.js";
import { Rig } from "./camera.js";
import { World } from "./world.js";

const MOST_PIXELS = 2; // of the screen for one CSS pixel: finer costs time and is not seen

export class Stage {
  /** Throws where the browser gives no WebGL. `colour(name)`: the theme's colour of that name. */
  constructor(canvas, flights, rules, colour) {
    const context = canvas.getContext("webgl2", { antialias: true, alpha: false, stencil: false });
    if (context === null) throw new Error("no WebGL");
    this.renderer = new WebGLRenderer({ canvas, context });
    this.renderer.autoClear = false;
    this.canvas = canvas;
    this.rules = rules;
    this.rig = new Rig();
    this.trueSize = false;
    this.size = { value: new Vector2(1, 1) };
    this.world = new World(rules.arena);
    this.hangars = ["defender", "attacker"].map((role) => new Hangar(colour(role)));
    this.models = flights.map((flight) => {
      const model = new Model(flight, this.hangars, rules, this.size, colour);
      this.world.scene.add(model.group);
      return model;
    });
    this.sights = flights.map((flight) => sights(flight, rules));
    this.page = new Color();
    this.paint(colour);
  }

  paint(colour) {
    this.world.paint(colour);
    this.page.set(colour("page"));
  }

  /** Fit the canvas's pixels to its place on the page. */
  resize() {
    const { clientWidth, clientHeight } = this.canvas;
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, MOST_PIXELS));
    this.renderer.setSize(Math.max(clientWidth, 1), Math.max(clientHeight, 1), false);
  }

  /** `views`: {index, left, top, width, height} in CSS pixels of the canvas. */
  draw(views, { time, fade }) {
    const { renderer } = this;
    const tall = this.canvas.clientHeight;
    const ratio = renderer.getPixelRatio();
    renderer.setScissorTest(false);
    renderer.setClearColor(this.page);
    renderer.clear();
    renderer.setScissorTest(true);
    for (const { index, left, top, width, height } of views) {
      const rectangle = [left, tall - top - height, width, height];
      renderer.setViewport(...rectangle);
      renderer.setScissor(...rectangle);
      renderer.clearDepth();
      this.size.value.set(width * ratio, height * ratio);
      this.models.forEach((model, other) => {
        model.group.visible = other === index;
      });
      const camera = this.cameraFor(index, time, width / height);
      const { trueSize, rig } = this;
      this.models[index].show(time, { trueSize, pixelRatio: ratio, fade, far: rig.distance });
      renderer.render(this.world.scene, camera);
    }
  }

  cameraFor(index, time, aspect) {
    const { models, sights: points, trueSize } = this;
    return this.rig.place(models[index].flight, time, points[index], aspect, trueSize);
  }

  dispose() {
    for (const part of [...this.models, ...this.hangars, this.world]) part.dispose();
    this.renderer.dispose();
    this.renderer.forceContextLoss();
  }
}

/** The time bar: a slider over a chart of distances (one fight) or of all fights' ends. */
import { DEFENDER } from "./flight.js";
import { element, seconds, svg } from "./dom.js";

const [WIDE, TALL] = [1000, 100]; // units of the chart
const POINTS = 300; // of a curve

export class Timeline {
  /** `onSeek(time)`: the slider was moved. */
  constructor(clock, rules, onSeek) {
    this.clock = clock;
    this.rules = rules;
    this.chart = svg("svg", {
      viewBox: `0 0 ${WIDE} ${TALL}`,
      preserveAspectRatio: "none",
      class: "chart",
    });
    this.chart.setAttribute("aria-hidden", "true");
    this.marks = element("div", { class: "marks", "aria-hidden": "true" });
    this.head = element("div", { class: "playhead" });
    this.legend = element("p", { class: "legend", "aria-hidden": "true" });
    this.slider = element("input", {
      type: "range",
      min: 0,
      step: 1,
      value: 0,
      "aria-label": "Time",
    });
    const seek = () => onSeek(Number(this.slider.value) * clock.dt);
    this.slider.addEventListener("input", seek);
    const track = element("div", { class: "track" }, this.chart, this.marks, this.head);
    this.box = element("div", { class: "timeline" }, track, this.legend, this.slider);
  }

  /** Draw the chart of `flights`: curves of a single one, the ends of several. */
  open(flights) {
    const { duration, dt, end } = this.clock;
    this.slider.max = Math.ceil(duration / dt - 1e-6);
    const x = (time) => (WIDE * time) / duration;
    const after = svg("rect", {
      class: "after",
      x: x(end),
      y: 0,
      width: WIDE - x(end),
      height: TALL,
    });
    this.chart.replaceChildren(after);
    this.legend.replaceChildren();
    if (flights.length === 1) this.drawCurves(flights[0], x);
    this.marks.replaceChildren(
      ...flights.flatMap((flight) => ticks(flight, flights.length > 1, duration)),
    );
    this.show();
  }

  show() {
    const { time, duration, dt, end } = this.clock;
    const frame = Math.round(time / dt);
    if (Number(this.slider.value) !== frame) this.slider.value = frame;
    this.slider.setAttribute("aria-valuetext", seconds(Math.min(time, end)));
    this.head.style.left = `${(100 * time) / duration}%`;
  }

  drawCurves(flight, x) {
    const [between, left] = flight.team
      ? ["nearest defender and attacker", "nearest attacker to target"]
      : ["between the drones", "attacker to target"];
    const curves = [["target", left, (time) => flight.toTarget(time)]];
    if (flight.mates(DEFENDER).length) {
      curves.unshift(["apart", between, (time) => flight.apart(time)]);
    }
    const times = Array.from({ length: POINTS + 1 }, (_, i) => (flight.end * i) / POINTS);
    const drawn = curves.map(([name, label, of]) => ({ name, label, values: times.map(of) }));
    const most = 1.08 * Math.max(1, ...drawn.flatMap(({ values }) => values));
    const y = (value) => TALL * (1 - value / most);
    const radius = y(this.rules.intercept);
    this.chart.append(svg("line", { class: "radius", x1: 0, x2: WIDE, y1: radius, y2: radius }));
    for (const { name, label, values } of drawn) {
      const points = values.map((value, i) => `${x(times[i]).toFixed(1)},${y(value).toFixed(1)}`);
      this.chart.append(svg("polyline", { class: `curve ${name}`, points: points.join(" ") }));
      this.legend.append(element("span", { class: name, text: label }));
    }
    this.legend.append(element("span", { text: `0 to ${most.toFixed(0)} m` }));
  }
}

/** Marks of a fight's events, or of its end alone; their title tells what happened. */
function ticks(flight, endAlone, duration) {
  const events = endAlone ? flight.events.slice(-1) : flight.events;
  return events.map(({ time, text, colour }) => {
    const title = `${endAlone ? `${flight.name}: ` : ""}${text}, ${seconds(time)}`;
    const mark = element("span", { class: "tick", "data-colour": colour, title });
    mark.style.left = `${(100 * time) / duration}%`;
    return mark;
  });
}

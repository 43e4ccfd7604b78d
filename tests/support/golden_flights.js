// Answers of the page's own code (`viewer/src/sim`), for node and for a browser alike.

/** `sim`: what `viewer/src/sim/index.js` exports; `asked`: plain JSON. */
function answer(sim, { game: raw, flights = [], states = [], pilots = [], events = [] }) {
  const game = new sim.Game(raw);
  const flown = flights.map(({ start, actions }) => {
    let state = start;
    return actions.map((both) => (state = game.step(state, both)));
  });
  const observed = states.map((state) => game.observe(state));
  const acts = pilots.map(({ pilot, role }) => {
    const act = game.pilot(pilot, role);
    return states.map((state) => act(state));
  });
  const causes = events.map(({ before, after, target, out, clock }) => {
    const found = sim.detect(game.rules, before, after, target, out, clock);
    return [sim.judge(game.rules, found), found.down];
  });
  return { flown, observed, acts, causes };
}

/**
 * Build the replay page's script from `src/` into the Python package, always to the same bytes.
 *
 *   npm install && npm run build
 *
 * The banner names the sources by their sha256, so that a test can tell whether the file is theirs
 * (`tests/report/test_replay_build.py` computes the same digest).
 */
import { createHash } from "node:crypto";
import { copyFileSync, readFileSync, readdirSync } from "node:fs";
import { resolve } from "node:path";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";

const OUT = process.argv[2] ?? "../dronecombat_jax/report/viewer";
const HERE = new URL(".", import.meta.url);
const FOLDER = fileURLToPath(HERE);

/** sha256 in hex over names and bytes of what the script is made from, in order of name. */
export function digest() {
  const sources = readdirSync(new URL("src/", HERE)).map((name) => `src/${name}`);
  const hash = createHash("sha256");
  for (const name of ["build.mjs", "package.json", ...sources].sort()) {
    const bytes = readFileSync(new URL(name, HERE));
    hash.update(`${name} ${bytes.length}\n`).update(bytes);
  }
  return hash.digest("hex");
}

const { version } = JSON.parse(readFileSync(new URL("node_modules/three/package.json", HERE)));
const licence = readFileSync(new URL("node_modules/three/LICENSE", HERE), "utf8").trim();
const banner = `/*!
dronecombat-jax replay page (MIT). Built by viewer/build.mjs; do not edit.
sources sha256 ${digest()}

It contains three.js ${version} (threejs.org), which is used under this licence:

${licence}
*/`;

await build({
  absWorkingDir: FOLDER,
  entryPoints: ["src/main.js"],
  outfile: resolve(FOLDER, OUT, "replay.js"),
  bundle: true,
  minify: true,
  charset: "ascii",
  format: "iife",
  target: "es2022",
  loader: { ".css": "text" },
  define: { SOURCES: JSON.stringify(digest()) },
  banner: { js: banner },
  legalComments: "none",
});
copyFileSync(new URL("node_modules/three/LICENSE", HERE), resolve(FOLDER, OUT, "three.LICENSE"));

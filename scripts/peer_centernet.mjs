// CenterNet-MobileNetV3 (COCO) of the npm package `@vladmandic/human`, run by TensorFlow.js on WebAssembly for
// compare_peers.py: node peer_centernet.mjs MODELS NODE_MODULES THREADS. On standard input come images of 512 x 512 x 3
// bytes; for each a line of JSON goes to standard output: milliseconds, and the detections [x1, y1, x2, y2, score,
// class].
import fs from "node:fs";
import path from "node:path";
import { createRequire } from "node:module";

const [models, modules, threads] = process.argv.slice(2);
const require = createRequire(path.join(path.resolve(modules), "x.js"));
const tf = require("@tensorflow/tfjs-core");
const { loadGraphModel } = require("@tensorflow/tfjs-converter");
const wasm = require("@tensorflow/tfjs-backend-wasm");

wasm.setWasmPaths(path.join(path.resolve(modules), "@tensorflow/tfjs-backend-wasm/dist/"));
wasm.setThreadsCount(Number(threads));
await tf.setBackend("wasm");
const graph = JSON.parse(fs.readFileSync(path.join(models, "centernet.json"), "utf8"));
const weights = fs.readFileSync(path.join(models, "centernet.bin"));
const model = await loadGraphModel({
  load: async () => ({
    modelTopology: graph.modelTopology,
    weightSpecs: graph.weightsManifest.flatMap((part) => part.weights),
    weightData: weights.buffer.slice(weights.byteOffset, weights.byteOffset + weights.byteLength),
    signature: graph.signature,
  }),
});

const SIDE = 512;
const LENGTH = SIDE * SIDE * 3;
let pending = Buffer.alloc(0);
for await (const chunk of process.stdin) {
  pending = Buffer.concat([pending, chunk]);
  while (pending.length >= LENGTH) {
    const pixels = Float32Array.from(pending.subarray(0, LENGTH));
    pending = pending.subarray(LENGTH);
    const start = performance.now();
    const input = tf.tensor4d(pixels, [1, SIDE, SIDE, 3]);
    const output = model.execute(input, ["tower_0/detections"]);
    const found = await output.array();
    tf.dispose([input, output]);
    console.log(JSON.stringify({ ms: performance.now() - start, found: found[0] }));
  }
}
console.error(JSON.stringify({ kib: process.resourceUsage().maxRSS }));

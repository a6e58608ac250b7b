// Decodes the streams from standard input, each behind its length in 4 bytes, with the npm package in a folder.
import { pathToFileURL } from 'node:url';
import { crc32 } from 'node:zlib';
const { decode } = await import(pathToFileURL(`${process.argv[2]}/index.js`));

const join = (digest, number) => ((digest << 5) | (digest >>> 27)) ^ number;

/** The digest of a scene, 0 for a stream that is refused. */
async function scene(stream, salvage) {
  try {
    const { means, rotations, logScales, opacityLogits, sh, memory } = await decode(stream, { worker: false, salvage });
    peak = Math.max(peak, memory);
    return [means, rotations, logScales, opacityLogits, sh].reduce((digest, a) => join(digest, crc32(a)), 1);
  } catch (thrown) {
    if (!['not-gsvx', 'version', 'truncated', 'damaged', 'limit'].includes(thrown.code)) throw thrown;
    return 0;
  }
}

/** The streams, as they arrive. */
async function* streams() {
  let rest = Buffer.alloc(0);
  for await (const piece of process.stdin) {
    rest = Buffer.concat([rest, piece]);
    while (rest.length >= 4 && rest.length >= 4 + rest.readUInt32LE()) {
      const end = 4 + rest.readUInt32LE();
      yield rest.subarray(4, end);
      rest = rest.subarray(end);
    }
  }
}

let [number, accepted, scenes, peak] = [0, 0, 0, 0];
const failed = [];
for await (const stream of streams()) {
  try {
    const [whole, salvaged] = [await scene(stream, false), await scene(stream, true)];
    scenes = join(join(scenes, whole), salvaged);
    accepted += whole !== 0;
  } catch (thrown) {
    console.error(`${number}: ${thrown.stack}`);
    failed.push(number);
  }
  number += 1;
}
console.log(JSON.stringify({ failed, streams: number, accepted, scenes: scenes >>> 0, peak }));

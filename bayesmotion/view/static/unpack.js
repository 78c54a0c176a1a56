// Series of numbers as view/packing.py packs them, and the tracks of a page made of them.
"use strict";

const UNKNOWN = -32768;

async function inflate(text) {
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let i = 0; i < bytes.length; i++) bytes[i] = binary.charCodeAt(i);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// Whole numbers [frame][series][column] of a text; its changes in time are added up.
async function unpack(text, series, frames, columns) {
  const planes = await inflate(text);
  const count = planes.length / 2;
  const out = new Int16Array(count);
  const stride = series * columns;
  let at = 0;
  for (let place = 0; place < stride; place++) {
    let sum = 0;
    for (let n = 0, to = place; n < frames; n++, to += stride, at++) {
      const z = planes[at] | (planes[count + at] << 8);
      sum = (sum + ((z >>> 1) ^ -(z & 1))) & 0xffff;
      out[to] = sum;
    }
  }
  return out;
}

async function trackOf(told) {
  const columns = 3 * told.joints.length;
  const track = { ...told, columns, duration: (told.frames - 1) / told.rate };
  track.where = await unpack(told.where, 1, told.frames, columns);
  track.draws = told.ghosts ? told.ghosts.count : 0;
  if (track.draws) {
    // Draws are told by how far they are from the mean.
    const all = await unpack(told.ghosts.where, track.draws, told.frames, columns);
    for (let n = 0, at = 0; n < told.frames; n++)
      for (let s = 0; s < track.draws; s++)
        for (let k = 0; k < columns; k++, at++) all[at] += track.where[n * columns + k];
    track.ghosts = all;
  }
  if (told.sd) {
    track.sd = await unpack(told.sd, 1, told.frames, told.joints.length);
    const sorted = Float32Array.from(track.sd.filter((value) => value >= 0)).sort();
    track.largestSd = sorted[Math.floor(0.98 * (sorted.length - 1))] * told.quantum;
  }
  track.known = knownPlace(track);
  return track;
}

async function cloudOf(told) {
  const cloud = { ...told, duration: (told.frames - 1) / told.rate };
  cloud.where = await unpack(told.where, 1, told.points, 3);
  cloud.begins = [0];
  for (const count of told.counts) cloud.begins.push(cloud.begins.at(-1) + count);
  cloud.known = (frame) => {
    const middle = [0, 0, 0];
    const [from, to] = [cloud.begins[frame], cloud.begins[frame + 1]];
    for (let i = from; i < to; i++)
      for (let k = 0; k < 3; k++) middle[k] += cloud.where[3 * i + k] / (to - from);
    return middle.map((value) => value * cloud.quantum);
  };
  return cloud;
}

// Where a body is, frame by frame: the middle of its known joints, the last one while none is.
function knownPlace(track) {
  const middles = new Float32Array(3 * track.frames);
  let last = [0, 0.5 * track.stature, 0];
  for (let n = 0; n < track.frames; n++) {
    const sum = [0, 0, 0];
    let count = 0;
    for (let at = n * track.columns; at < (n + 1) * track.columns; at += 3) {
      if (track.where[at] === UNKNOWN) continue;
      for (let k = 0; k < 3; k++) sum[k] += track.where[at + k];
      count++;
    }
    if (count) last = sum.map((value) => (value / count) * track.quantum);
    middles.set(last, 3 * n);
  }
  return (frame) => middles.subarray(3 * frame, 3 * frame + 3);
}

// Bodies, markers and voxels as capsules at one moment.
"use strict";

// Radii in heights of the body.
const BONE = 0.0135, GHOST = 0.006, HEAD = 0.055, MARKER = 0.012;
// Viridis (CC0; S. van der Walt and N. Smith), which is told apart with every kind of colour vision.
const VIRIDIS = ["440154", "472d7b", "3b528b", "2c728e", "21918c", "28ae80", "5ec962", "addc30", "fde725"];
const RAMP = VIRIDIS.map(rgb);

function rgb(hex) {
  const number = parseInt(hex.replace("#", ""), 16);
  return [(number >> 16) / 255, ((number >> 8) & 255) / 255, (number & 255) / 255];
}

function ramp(share) {
  const at = Math.min(Math.max(share, 0), 1) * (RAMP.length - 1);
  const low = Math.min(Math.floor(at), RAMP.length - 2);
  return RAMP[low].map((value, k) => value + (at - low) * (RAMP[low + 1][k] - value));
}

// A list of capsules that grows as it needs.
class Capsules {
  constructor() {
    this.values = new Float32Array(FLOATS * 256);
    this.count = 0;
  }

  clear() {
    this.count = 0;
  }

  add(ax, ay, az, bx, by, bz, radius, colour, alpha) {
    const at = FLOATS * this.count++;
    if (at + FLOATS > this.values.length) {
      const larger = new Float32Array(2 * this.values.length);
      larger.set(this.values);
      this.values = larger;
    }
    const v = this.values;
    v[at] = ax; v[at + 1] = ay; v[at + 2] = az;
    v[at + 3] = bx; v[at + 4] = by; v[at + 5] = bz;
    v[at + 6] = radius;
    v[at + 7] = colour[0]; v[at + 8] = colour[1]; v[at + 9] = colour[2]; v[at + 10] = alpha;
  }
}

// The frame before a moment (s), and how far it is to the next one.
function momentOf(track, seconds) {
  const at = Math.min(Math.max(seconds * track.rate, 0), track.frames - 1);
  // Whole frames are met in spite of rounding.
  const frame = Math.min(Math.floor(at + 1e-6), track.frames - 1);
  const share = frame < track.frames - 1 ? Math.max(at - frame, 0) : 0;
  return { frame, share: share < 1e-4 ? 0 : share };
}

// Joints between two frames into `out`; NaN where they are not known in both.
function placed(values, quantum, from, to, share, columns, out) {
  for (let k = 0; k < columns; k++) {
    const a = values[from + k], b = values[to + k];
    out[k] = a === UNKNOWN || (share > 0 && b === UNKNOWN) ? NaN : quantum * (a + share * (b - a));
  }
}

// How many draws are shown of so many, evenly spread.
function chosenDraws(count, most) {
  const shown = Math.min(count, most);
  return Array.from({ length: shown }, (_, i) => Math.floor(((i + 0.5) * count) / shown));
}

class Figures {
  constructor() {
    this.solid = new Capsules();
    this.ghosts = new Capsules();
    this.joints = new Float32Array(0);
  }

  clear() {
    this.solid.clear();
    this.ghosts.clear();
  }

  // colourOf(joint, frame) is the colour of what ends at a joint.
  body(track, seconds, colourOf) {
    const { frame, share } = momentOf(track, seconds);
    const next = Math.min(frame + 1, track.frames - 1);
    this._place(track, track.where, frame * track.columns, next * track.columns, share);
    const p = this.joints;
    if (!track.bones.length) {
      const radius = MARKER * track.stature;
      for (let j = 0; j < track.joints.length; j++) {
        const i = 3 * j;
        if (p[i] === p[i]) this.solid.add(p[i], p[i + 1], p[i + 2], p[i], p[i + 1], p[i + 2], radius, colourOf(j, frame), 1);
      }
      return;
    }
    // Where both are in one place, as in what was given, the truth is inside the mean.
    const radius = (track.role === "truth" ? 0.85 : 1) * BONE * track.stature;
    this._bones(track, this.solid, radius, (j) => colourOf(j, frame), 1);
  }

  draws(track, seconds, chosen, colour, alpha) {
    const { frame, share } = momentOf(track, seconds);
    const next = Math.min(frame + 1, track.frames - 1);
    const stride = track.draws * track.columns;
    for (const draw of chosen) {
      const from = frame * stride + draw * track.columns, to = next * stride + draw * track.columns;
      this._place(track, track.ghosts, from, to, share);
      this._bones(track, this.ghosts, GHOST * track.stature, () => colour, alpha);
    }
  }

  points(cloud, seconds, colour) {
    const { frame } = momentOf(cloud, seconds);
    const w = cloud.where, q = cloud.quantum, radius = 0.45 * cloud.size;
    for (let i = cloud.begins[frame]; i < cloud.begins[frame + 1]; i++) {
      const x = q * w[3 * i], y = q * w[3 * i + 1], z = q * w[3 * i + 2];
      this.solid.add(x, y, z, x, y, z, radius, colour, 1);
    }
  }

  _place(track, values, from, to, share) {
    if (this.joints.length < track.columns) this.joints = new Float32Array(track.columns);
    placed(values, track.quantum, from, to, share, track.columns, this.joints);
  }

  _bones(track, list, radius, colourOf, alpha) {
    const p = this.joints;
    for (const [parent, joint] of track.bones) {
      const a = 3 * parent, b = 3 * joint;
      if (p[a] !== p[a] || p[b] !== p[b]) continue;
      list.add(p[a], p[a + 1], p[a + 2], p[b], p[b + 1], p[b + 2], radius, colourOf(joint), alpha);
    }
    if (!track.head) return;
    const [a, b] = track.head.map((joint) => 3 * joint);
    const along = [p[b] - p[a], p[b + 1] - p[a + 1], p[b + 2] - p[a + 2]];
    const length = Math.hypot(...along);
    if (!(length > 0)) return;
    const size = (track.role === "truth" ? 0.96 : 1) * HEAD * track.stature;
    const [x, y, z] = along.map((value, k) => p[b + k] - (size * value) / length);
    // The head of a ghost is a small one: a disc would hide more than lines do.
    list.add(x, y, z, x, y, z, list === this.ghosts ? 3 * radius : size, colourOf(track.head[1]), alpha);
  }
}

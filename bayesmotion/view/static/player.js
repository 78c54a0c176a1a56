// The player: what is shown at which moment, and what people do with it.
"use strict";

const FLUENT = 25; // pictures a second below which something is left out
const OTHERS = ["#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#0072B2"];
const MOST_AT_ONCE = 6; // bodies that are shown when the page is opened
const byId = (id) => document.getElementById(id);

class Player {
  constructor(content, tracks, clouds, renderer) {
    this.content = content;
    this.renderer = renderer;
    this.figures = new Figures();
    this.things = [...tracks, ...clouds];
    this.things.forEach((thing, i) => { thing.shown = i < MOST_AT_ONCE; });
    // Frames are those of the fastest.
    this.rate = Math.max(...this.things.map((thing) => thing.rate));
    this.duration = Math.max(...this.things.map((thing) => thing.duration));
    this.frames = Math.round(this.duration * this.rate) + 1;
    this.told = tracks.find((track) => track.context !== null) || null;
    this.drawn = Math.max(0, ...tracks.map((track) => track.draws || 0));
    this.spread = Math.max(0, ...tracks.map((track) => track.largestSd || 0));
    this.most = this.drawn;
    this.ghosts = this.drawn > 0;
    this.beside = content.arrangement === "beside";
    this.seconds = 0;
    this.speed = 1;
    this.playing = false;
    this.loop = true;
    this.follow = true;
    this.colour = tracks.length > 1 || this.drawn ? "track" : "side";
    this.ratio = Math.min(window.devicePixelRatio || 1, 2);
    this.sharpness = 1;
    this.pictures = { since: 0, count: 0, rate: 0, slow: 0 };
    this.camera = this.firstCamera();
    this.dirty = true;
  }

  firstCamera() {
    const heights = this.things.map((thing) => thing.stature || 1.7);
    return { azimuth: this.facing() + 0.6, elevation: 0.16, distance: 2 * Math.max(...heights), shift: [0, 0, 0] };
  }

  // The direction, as an angle about the vertical, in which the first body goes.
  facing() {
    const thing = this.things[0];
    const from = Array.from(thing.known(0)), to = thing.known(thing.frames - 1);
    const [x, z] = [to[0] - from[0], to[2] - from[2]];
    return Math.hypot(x, z) > 0.2 ? Math.atan2(x, z) : 0;
  }

  // What each panel shows.
  panels() {
    const shown = this.things.filter((thing) => thing.shown);
    return this.beside && shown.length > 1 ? shown.map((thing) => [thing]) : [shown];
  }

  boxes(count, width, height) {
    let best = { columns: 1, size: 0 };
    for (let columns = 1; columns <= count; columns++) {
      const rows = Math.ceil(count / columns);
      // A body is about as high as wide.
      const size = Math.min(width / columns, height / rows);
      if (size > best.size + 1) best = { columns, size };
    }
    const rows = Math.ceil(count / best.columns);
    const [w, h] = [width / best.columns, height / rows];
    return Array.from({ length: count }, (_, i) =>
      ({ x: w * (i % best.columns), y: h * Math.floor(i / best.columns), width: w, height: h }));
  }

  colourOf(thing) {
    if (thing.counts) return this.theme.voxel;
    if (thing.role === "truth" || thing.role === "mean") return this.theme[thing.role];
    const motions = this.things.filter((other) => other.role === "motion");
    return rgb(OTHERS[motions.indexOf(thing) % OTHERS.length]);
  }

  jointColour(track) {
    if (this.colour === "side") {
      const sides = [this.theme.left, this.theme.right, this.theme.truth];
      return (joint) => sides[track.sides[joint]];
    }
    if (this.colour === "uncertainty" && track.sd) {
      const joints = track.joints.length;
      return (joint, frame) => ramp((track.sd[frame * joints + joint] * track.quantum) / this.spread);
    }
    const colour = this.colourOf(track);
    return () => colour;
  }

  readTheme() {
    const style = getComputedStyle(document.documentElement);
    const names = ["paper", "ground", "truth", "mean", "ghost", "left", "right", "voxel"];
    this.theme = Object.fromEntries(names.map((name) => [name, rgb(style.getPropertyValue("--" + name).trim())]));
    this.dirty = true;
  }

  draw() {
    this.renderer.resize(this.ratio * this.sharpness);
    const canvas = this.renderer.canvas;
    const panels = this.panels();
    const boxes = this.boxes(panels.length, canvas.clientWidth, canvas.clientHeight);
    panels.forEach((things, i) => this.drawPanel(things, boxes[i]));
    this.dirty = false;
    return { panels, boxes };
  }

  drawPanel(things, box) {
    const { camera, figures, renderer } = this;
    const leader = things.find((thing) => thing.role === "mean") || things[0];
    const moment = leader && this.follow ? momentOf(leader, this.seconds).frame : 0;
    const target = leader ? Array.from(leader.known(moment)) : [0, 0.9, 0];
    // Up and down the eye stays: only walking is followed.
    if (leader && !leader.counts) target[1] = 0.52 * leader.stature;
    target.forEach((_, k) => { target[k] += camera.shift[k]; });
    renderer.panel(box, { ...camera, target }, this.theme.paper);
    renderer.floor([target[0], 0, target[2]], this.theme.ground);
    figures.clear();
    for (const thing of things) {
      if (this.seconds > thing.duration + 0.5 / thing.rate) continue;
      if (thing.counts) {
        figures.points(thing, this.seconds, this.theme.voxel);
        continue;
      }
      figures.body(thing, this.seconds, this.jointColour(thing));
      if (this.ghosts && thing.draws) {
        const chosen = chosenDraws(thing.draws, this.most);
        const alpha = Math.min(0.5, 0.16 + 1.6 / chosen.length);
        figures.draws(thing, this.seconds, chosen, this.theme.ghost, alpha);
      }
    }
    const { solid, ghosts } = figures;
    renderer.capsules(solid.values, solid.count, { shadow: true });
    renderer.capsules(solid.values, solid.count);
    renderer.capsules(ghosts.values, ghosts.count, { solid: false });
  }

  get frame() {
    return Math.min(Math.floor(this.seconds * this.rate + 1e-6), this.frames - 1);
  }

  seek(frame) {
    const last = this.frames - 1;
    this.seconds = Math.min(Math.max(Math.round(frame), 0), last) / this.rate;
    this.onSeek?.();
    this.dirty = true;
  }

  // Count pictures while it plays; where there are too few, leave something out, and say so.
  count(now) {
    const p = this.pictures;
    if (!p.since) Object.assign(p, { since: now, count: 0 });
    p.count++;
    const passed = (now - p.since) / 1000;
    if (passed < 1) return;
    p.rate = p.count / passed;
    Object.assign(p, { since: now, count: 0 });
    // A page in the background is not drawn at all: that tells nothing.
    if (p.rate < 0.5) return;
    p.slow = p.rate < FLUENT ? p.slow + 1 : 0;
    // One slow second may be anything.
    if (p.slow < 2) return;
    p.slow = 1;
    if (this.ratio * this.sharpness > 0.75) this.sharpness *= 0.75;
    else if (this.ghosts && this.most > 4) this.most = Math.ceil(this.most / 2);
    this.onSlower?.();
  }

  // Show everything again.
  restore() {
    this.most = this.drawn;
    this.sharpness = 1;
    this.pictures.slow = 0;
  }

  state() {
    return {
      frame: this.frame, frames: this.frames, seconds: this.seconds, rate: this.rate, playing: this.playing,
      pictures: this.pictures.rate, draws: this.drawn, drawsShown: this.ghosts ? this.most : 0,
      sharpness: this.sharpness, panels: this.panels().length,
    };
  }
}

// Buttons, keys and fingers; the clock; sound; and how the page begins.
"use strict";

function element(kind, properties, ...children) {
  const made = Object.assign(document.createElement(kind), properties);
  made.append(...children);
  return made;
}

function checkbox(text, checked, change, colour) {
  const box = element("input", { type: "checkbox", checked });
  box.addEventListener("change", () => change(box.checked));
  const label = element("label", {}, box);
  if (colour) {
    const swatch = element("span", { className: "swatch" });
    swatch.style.background = colour;
    label.append(swatch);
  }
  label.append(text);
  return { box, label };
}

const css = (colour) => `rgb(${colour.map((value) => Math.round(255 * value)).join(" ")})`;

class Controls {
  constructor(player, sound) {
    this.player = player;
    this.sound = sound;
    this.last = 0;
    this.lists();
    this.buttons();
    this.keys();
    this.fingers();
    player.onSeek = () => this.sound?.jump(player.seconds);
    player.onSlower = () => this.notice();
    const again = () => { player.readTheme(); this.legend(); };
    window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", again);
    new ResizeObserver(() => { player.dirty = true; }).observe(byId("stage"));
    again();
    requestAnimationFrame((now) => this.tick(now));
  }

  tick(now) {
    const { player } = this;
    const passed = Math.min((now - this.last) / 1000, 0.25);
    this.last = now;
    if (player.playing) {
      const heard = this.sound?.now();
      player.seconds = heard ?? player.seconds + passed * player.speed;
      if (player.seconds > player.duration + 0.5 / player.rate) {
        player.seconds = 0;
        this.sound?.jump(0);
      }
      player.dirty = true;
    }
    if (player.dirty) {
      this.show(player.draw());
      if (player.playing) player.count(now);
    }
    requestAnimationFrame((next) => this.tick(next));
  }

  show({ panels, boxes }) {
    const { player } = this;
    byId("scrubber").value = player.frame;
    byId("clock").textContent = this.clock();
    const names = panels.length > 1 ? panels.map(([thing]) => thing.name) : [];
    const key = JSON.stringify([names, boxes]);
    if (key === this.labelled) return;
    this.labelled = key;
    byId("labels").replaceChildren(...names.map((name, i) => {
      const label = element("span", {}, name);
      Object.assign(label.style, { left: `${boxes[i].x}px`, top: `${boxes[i].y}px` });
      return label;
    }));
  }

  clock() {
    const { player } = this;
    const text = `${player.seconds.toFixed(2)} s · frame ${player.frame}/${player.frames - 1}`;
    if (!player.told) return text;
    const { frame } = momentOf(player.told, player.seconds);
    return `${text} · ${frame < player.told.context ? "context" : "forecast"}`;
  }

  play(on = !this.player.playing) {
    const { player } = this;
    player.playing = on;
    player.pictures.since = 0;
    byId("play").textContent = on ? "❚❚" : "▶";
    byId("play").setAttribute("aria-label", on ? "Stop" : "Play");
    if (on) this.sound?.play(player.seconds, player.speed);
    else {
      this.sound?.stop();
      // It stops at a frame, not between two.
      player.seek(player.frame);
    }
  }

  lists() {
    const { player } = this;
    this.boxes = player.things.map((thing) =>
      checkbox(thing.name, thing.shown, (on) => { thing.shown = on; player.dirty = true; }, "none"));
    byId("tracks").append(...this.boxes.map(({ label }) => label));
    if (player.drawn) {
      const switched = (on) => { player.ghosts = on; player.restore(); player.dirty = true; this.notice(); };
      this.draws = checkbox(`${player.drawn} draws`, true, switched, "none");
      this.draws.box.id = "ghosts";
      byId("tracks").append(this.draws.label);
    }
    const colours = [["track", "what it is"], ["side", "left and right"]];
    if (player.spread) colours.push(["uncertainty", "uncertainty"]);
    byId("colour").append(...colours.map(([value, text]) => element("option", { value }, text)));
    byId("colour").value = player.colour;
    byId("arranging").hidden = player.things.length < 2;
    byId("colouring").hidden = !player.things.some((thing) => thing.bones?.length);
    byId("messages").append(...player.content.messages.map((text) => element("li", {}, text)));
    if (player.told) {
      const share = (100 * (player.told.context - 0.5)) / player.told.rate / Math.max(player.duration, 1e-9);
      Object.assign(byId("told"), { textContent: "context" }).style.width = `${share}%`;
      Object.assign(byId("ahead"), { textContent: "forecast" }).style.width = `${100 - share}%`;
    } else {
      byId("parts").hidden = true;
      byId("line").className = "whole";
    }
  }

  // The colours of the list, which go with what is coloured, and the scale of uncertainty.
  legend() {
    const { player } = this;
    player.things.forEach((thing, i) => {
      const swatch = this.boxes[i].label.querySelector(".swatch");
      const { theme } = player;
      if (player.colour === "side" && !thing.counts)
        swatch.style.background = `linear-gradient(90deg, ${css(theme.left)} 50%, ${css(theme.right)} 50%)`;
      else if (player.colour === "uncertainty" && thing.sd)
        swatch.style.background = `linear-gradient(90deg, ${RAMP.map(css).join(",")})`;
      else swatch.style.background = css(player.colourOf(thing));
      swatch.title = player.colour === "side" ? "left, right" : "";
    });
    if (this.draws) this.draws.label.querySelector(".swatch").style.background = css(player.theme.ghost);
    byId("scale").hidden = player.colour !== "uncertainty";
    byId("ramp").style.background = `linear-gradient(90deg, ${RAMP.map(css).join(",")})`;
    byId("largest").textContent = `0 to ${(1000 * player.spread).toFixed(0)} mm, sd of where a joint is`;
  }

  notice() {
    const { player } = this;
    const said = [];
    if (player.most < player.drawn && player.ghosts)
      said.push(`${player.most} of ${player.drawn} draws are shown`);
    if (player.sharpness < 1) said.push("pictures are coarser");
    byId("notice").textContent = said.length
      ? `${said.join(", ")}, so that it plays at ${FLUENT} pictures a second here` : "";
  }

  buttons() {
    const { player } = this;
    const on = (id, kind, act) => byId(id).addEventListener(kind, () => { act(byId(id)); player.dirty = true; });
    byId("scrubber").max = player.frames - 1;
    on("scrubber", "input", (bar) => player.seek(Number(bar.value)));
    on("play", "click", () => this.play());
    on("speed", "change", (list) => { player.speed = Number(list.value); this.sound?.pace(player.speed); });
    on("colour", "change", (list) => { player.colour = list.value; this.legend(); });
    byId("beside").checked = player.beside;
    on("beside", "change", (box) => { player.beside = box.checked; });
    on("follow", "change", (box) => { player.follow = box.checked; });
    on("reset", "click", () => { player.camera = player.firstCamera(); });
    on("theme", "click", () => {
      const dark = window.matchMedia("(prefers-color-scheme: dark)").matches;
      const now = document.documentElement.dataset.theme || (dark ? "dark" : "light");
      document.documentElement.dataset.theme = now === "dark" ? "light" : "dark";
      player.readTheme();
      this.legend();
    });
  }

  keys() {
    const { player } = this;
    const flip = (id) => byId(id)?.click();
    const pace = (by) => {
      const list = byId("speed");
      list.selectedIndex = Math.min(Math.max(list.selectedIndex + by, 0), list.options.length - 1);
      list.dispatchEvent(new Event("change"));
    };
    const acts = {
      " ": () => this.play(),
      ArrowLeft: (event) => player.seek(player.frame - (event.shiftKey ? 10 : 1)),
      ArrowRight: (event) => player.seek(player.frame + (event.shiftKey ? 10 : 1)),
      Home: () => player.seek(0),
      End: () => player.seek(player.frames - 1),
      "+": () => pace(1), "-": () => pace(-1),
      g: () => flip("ghosts"), s: () => flip("beside"), f: () => flip("follow"),
    };
    document.addEventListener("keydown", (event) => {
      const act = acts[event.key];
      // Lists have keys of their own, and space presses buttons.
      const own = event.target.tagName === "SELECT" || event.target.tagName === "SUMMARY";
      if (!act || own || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      if (event.target.tagName === "BUTTON" || event.target.type === "checkbox") event.target.blur();
      act(event);
    });
  }

  fingers() {
    const canvas = byId("scene");
    const held = new Map();
    const { player } = this;
    const changed = () => { player.dirty = true; };
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      canvas.classList.add("turning");
      held.set(event.pointerId, event);
    });
    const released = (event) => { held.delete(event.pointerId); canvas.classList.remove("turning"); };
    canvas.addEventListener("pointerup", released);
    canvas.addEventListener("pointercancel", released);
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("pointermove", (event) => {
      const before = held.get(event.pointerId);
      if (!before) return;
      const [dx, dy] = [event.clientX - before.clientX, event.clientY - before.clientY];
      const other = [...held.values()].find((one) => one.pointerId !== event.pointerId);
      if (other) {
        const span = (one) => Math.hypot(one.clientX - other.clientX, one.clientY - other.clientY);
        this.zoom(span(before) / Math.max(span(event), 1));
        this.shift(dx / 2, dy / 2);
      } else if (event.shiftKey || event.buttons & 2) this.shift(dx, dy);
      else {
        player.camera.azimuth -= 0.008 * dx;
        player.camera.elevation = Math.min(Math.max(player.camera.elevation + 0.008 * dy, -0.2), 1.5);
      }
      held.set(event.pointerId, event);
      changed();
    });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(0.0015 * Math.max(-300, Math.min(300, event.deltaY))));
      changed();
    }, { passive: false });
    canvas.addEventListener("dblclick", () => { player.camera = player.firstCamera(); changed(); });
  }

  zoom(by) {
    const { camera } = this.player;
    camera.distance = Math.min(Math.max(camera.distance * by, 0.3), 60);
  }

  shift(dx, dy) {
    const { camera, renderer } = this.player;
    const { right, up, slope } = renderer.view;
    const step = (2 * slope * camera.distance) / Math.max(renderer.canvas.clientHeight, 1);
    for (let k = 0; k < 3; k++) camera.shift[k] += step * (dy * up[k] - dx * right[k]);
  }
}

// A sound that the motion keeps in step with: while it is heard, it tells the time.
class Heard {
  constructor({ kind, data, start }) {
    this.start = start;
    this.audio = new Audio(`data:${kind};base64,${data}`);
    this.audio.preload = "auto";
    this.audio.preservesPitch = true;
  }

  // The moment of the motion that is heard, nothing while none is.
  now() {
    const { audio } = this;
    if (audio.paused || audio.ended || audio.readyState < 2) return null;
    return Math.max(audio.currentTime - this.start, 0);
  }

  play(seconds, speed) {
    this.jump(seconds);
    this.pace(speed);
    // A browser that lets nothing be heard yet shows the motion all the same.
    this.audio.play().catch(() => this.stop());
  }

  stop() {
    this.audio.pause();
  }

  jump(seconds) {
    this.audio.currentTime = seconds + this.start;
  }

  pace(speed) {
    this.audio.playbackRate = speed;
  }
}

async function begin() {
  try {
    if (!window.DecompressionStream) throw new Error("this browser is too old: take one of 2023 or later");
    const content = JSON.parse(byId("content").textContent);
    const renderer = new Renderer(byId("scene"));
    const tracks = await Promise.all(content.tracks.map(trackOf));
    const clouds = await Promise.all(content.clouds.map(cloudOf));
    const player = new Player(content, tracks, clouds, renderer);
    const controls = new Controls(player, content.sound ? new Heard(content.sound) : null);
    window.player = {
      seek: (frame) => player.seek(frame),
      play: (on) => controls.play(on),
      state: () => ({ ...player.state(), heard: controls.sound?.now() ?? null }),
    };
    document.documentElement.dataset.ready = "yes";
  } catch (reason) {
    byId("notice").className = "broken";
    byId("notice").textContent = `Nothing can be shown: ${reason.message}.`;
    document.documentElement.dataset.ready = "no";
  }
}

begin();

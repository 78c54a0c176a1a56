// Drawing with WebGL: capsules (bones, heads, points) as flat quads that are lit like round ones,
// and the floor. Colours are rows [r, g, b] between 0 and 1.
"use strict";

const FLOATS = 11; // of an instance: two ends, radius, colour with alpha
const FIELD_OF_VIEW = (36 * Math.PI) / 180;

const CAPSULE_VERTEX = `#version 300 es
layout(location = 0) in vec2 corner;
layout(location = 1) in vec3 start;
layout(location = 2) in vec3 end;
layout(location = 3) in float size;
layout(location = 4) in vec4 colour;
uniform mat4 camera;
uniform vec3 eye;
uniform float pixel;
uniform bool shadow;
out vec2 place;
out float reach;
out float radius;
out vec4 tint;
void main() {
  vec3 a = start, b = end, towards;
  if (shadow) {
    a.y = b.y = 0.004;
    towards = vec3(0.0, 1.0, 0.0);
  } else {
    towards = normalize(eye - 0.5 * (a + b));
  }
  // Never thinner than a line that is seen.
  radius = max(size, 0.7 * pixel * distance(eye, 0.5 * (a + b)));
  vec3 along = b - a;
  along -= dot(along, towards) * towards;
  reach = length(along);
  vec3 other = abs(towards.y) < 0.9 ? vec3(0.0, 1.0, 0.0) : vec3(1.0, 0.0, 0.0);
  vec3 u = reach > 1e-5 ? along / reach : normalize(cross(towards, other));
  vec3 v = cross(towards, u);
  bool first = corner.x < 0.5;
  vec3 world = (first ? a : b) + radius * ((first ? -1.0 : 1.0) * u + corner.y * v);
  place = vec2(first ? -radius : reach + radius, corner.y * radius);
  tint = colour;
  gl_Position = camera * vec4(world, 1.0);
}`;

const CAPSULE_FRAGMENT = `#version 300 es
precision highp float;
in vec2 place;
in float reach;
in float radius;
in vec4 tint;
uniform bool lit;
uniform bool shadow;
out vec4 seen;
void main() {
  float away = length(vec2(place.x - clamp(place.x, 0.0, reach), place.y));
  float edge = clamp((radius - away) / max(fwidth(away), 1e-6) + 0.5, 0.0, 1.0);
  if (edge < (shadow ? 0.5 : 0.02)) discard;
  if (shadow) {
    seen = vec4(0.0, 0.0, 0.0, 0.13);
    return;
  }
  float facing = sqrt(max(0.0, 1.0 - away * away / (radius * radius)));
  float light = lit ? 0.62 + 0.38 * facing : 1.0;
  float alpha = tint.a * edge;
  seen = vec4(tint.rgb * light * alpha, alpha);
}`;

const FLOOR_VERTEX = `#version 300 es
layout(location = 0) in vec2 corner;
uniform mat4 camera;
uniform vec3 middle;
uniform float extent;
out vec2 place;
out vec2 away;
void main() {
  away = vec2(2.0 * corner.x - 1.0, corner.y);
  place = middle.xz + extent * away;
  gl_Position = camera * vec4(place.x, 0.0, place.y, 1.0);
}`;

const FLOOR_FRAGMENT = `#version 300 es
precision highp float;
in vec2 place;
in vec2 away;
uniform vec3 colour;
out vec4 seen;
void main() {
  vec2 line = abs(fract(place - 0.5) - 0.5) / fwidth(place);
  float strength = 1.0 - clamp(min(line.x, line.y) - 0.3, 0.0, 1.0);
  float alpha = 0.55 * strength * clamp(1.0 - dot(away, away), 0.0, 1.0);
  seen = vec4(colour * alpha, alpha);
}`;

class Renderer {
  constructor(canvas) {
    this.canvas = canvas;
    const gl = canvas.getContext("webgl2", { antialias: false, alpha: false, stencil: true });
    if (!gl) throw new Error("this browser has no WebGL 2, which the player draws with");
    this.gl = gl;
    this.capsule = programOf(gl, CAPSULE_VERTEX, CAPSULE_FRAGMENT);
    this.ground = programOf(gl, FLOOR_VERTEX, FLOOR_FRAGMENT);
    this.instances = gl.createBuffer();
    this.array = gl.createVertexArray();
    gl.bindVertexArray(this.array);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([0, -1, 0, 1, 1, -1, 1, 1]), gl.STATIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 2, gl.FLOAT, false, 0, 0);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.instances);
    let offset = 0;
    [3, 3, 1, 4].forEach((size, index) => {
      gl.enableVertexAttribArray(index + 1);
      gl.vertexAttribPointer(index + 1, size, gl.FLOAT, false, 4 * FLOATS, offset);
      gl.vertexAttribDivisor(index + 1, 1);
      offset += 4 * size;
    });
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthFunc(gl.LEQUAL);
    gl.polygonOffset(1, 64);
    // The shadows of two bones are no darker than that of one.
    gl.stencilFunc(gl.EQUAL, 0, 0xff);
    gl.stencilOp(gl.KEEP, gl.KEEP, gl.INCR);
  }

  resize(ratio) {
    const [width, height] = [this.canvas.clientWidth, this.canvas.clientHeight];
    const [w, h] = [Math.max(1, Math.round(width * ratio)), Math.max(1, Math.round(height * ratio))];
    if (this.canvas.width !== w || this.canvas.height !== h) {
      this.canvas.width = w;
      this.canvas.height = h;
    }
    this.ratio = w / Math.max(width, 1);
  }

  // Begin a panel: x, y (from the top left), width and height in CSS pixels, and its background.
  panel(box, camera, background) {
    const gl = this.gl;
    const to = (value) => Math.round(value * this.ratio);
    const area = [to(box.x), this.canvas.height - to(box.y + box.height), to(box.width), to(box.height)];
    gl.viewport(...area);
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(...area);
    gl.depthMask(true);
    gl.clearColor(...background, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
    const aspect = box.width / box.height;
    this.view = viewOf(camera, aspect);
    // A panel that is taller than wide sees as much across as a square one.
    this.pixel = (2 * this.view.slope) / Math.max(area[3], 1);
  }

  floor(middle, colour) {
    const gl = this.gl;
    gl.useProgram(this.ground.program);
    gl.uniformMatrix4fv(this.ground.at.camera, false, this.view.matrix);
    gl.uniform3fv(this.ground.at.middle, middle);
    gl.uniform3fv(this.ground.at.colour, colour);
    gl.uniform1f(this.ground.at.extent, 9);
    gl.disable(gl.DEPTH_TEST);
    gl.disable(gl.STENCIL_TEST);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  }

  // Draw the first `count` capsules; solid ones hide what is behind, others are seen through.
  capsules(values, count, { solid = true, shadow = false } = {}) {
    if (!count) return;
    const gl = this.gl;
    gl.useProgram(this.capsule.program);
    gl.uniformMatrix4fv(this.capsule.at.camera, false, this.view.matrix);
    gl.uniform3fv(this.capsule.at.eye, this.view.eye);
    gl.uniform1f(this.capsule.at.pixel, this.pixel);
    gl.uniform1i(this.capsule.at.shadow, shadow);
    gl.uniform1i(this.capsule.at.lit, solid);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.instances);
    gl.bufferData(gl.ARRAY_BUFFER, values.subarray(0, FLOATS * count), gl.DYNAMIC_DRAW);
    const [on, off] = shadow ? [gl.STENCIL_TEST, gl.DEPTH_TEST] : [gl.DEPTH_TEST, gl.STENCIL_TEST];
    gl.enable(on);
    gl.disable(off);
    gl.depthMask(solid && !shadow);
    // Ghosts that are where the body is lie behind it.
    if (solid) gl.disable(gl.POLYGON_OFFSET_FILL);
    else gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, count);
  }
}

function programOf(gl, vertex, fragment) {
  const program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS))
    throw new Error(`the graphics driver refuses the player's program: ${gl.getProgramInfoLog(program)}`);
  const at = {};
  for (let i = 0; i < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); i++) {
    const name = gl.getActiveUniform(program, i).name;
    at[name] = gl.getUniformLocation(program, name);
  }
  return { program, at };
}

// The place of the eye, and the matrix (by columns) of a camera {target, azimuth, elevation, distance}.
function viewOf({ target, azimuth, elevation, distance }, aspect) {
  const [ca, sa, ce, se] = [Math.cos(azimuth), Math.sin(azimuth), Math.cos(elevation), Math.sin(elevation)];
  const back = [ce * sa, se, ce * ca];
  const right = [ca, 0, -sa];
  const up = [-se * sa, ce, -se * ca];
  const eye = target.map((value, k) => value + distance * back[k]);
  const slope = Math.tan(FIELD_OF_VIEW / 2) / Math.min(1, aspect);
  const [near, far] = [0.02 * distance, 60 + 4 * distance];
  const dot = (a) => -(a[0] * eye[0] + a[1] * eye[1] + a[2] * eye[2]);
  const [x, y] = [1 / (slope * aspect), 1 / slope];
  const [z, w] = [(far + near) / (near - far), (2 * far * near) / (near - far)];
  const matrix = new Float32Array(16);
  for (let k = 0; k < 3; k++) matrix.set([x * right[k], y * up[k], z * back[k], -back[k]], 4 * k);
  matrix.set([x * dot(right), y * dot(up), z * dot(back) + w, -dot(back)], 12);
  return { eye, matrix, right, up, slope };
}

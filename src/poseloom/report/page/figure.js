"use strict";
// The moving 3D figure: poses from packed pose vectors, bodies of elliptic tubes, drawn with WebGL 2, or flat without it.

const JOINT_FLOATS = 4;
const LIMB_FLOATS = 16; // start 3, end 3, side 3, radii 4, colour 3

/** Little-endian numbers from base64. */
function unpack(text, Type) {
  const raw = atob(text);
  const bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
  return new Type(bytes.buffer);
}

/** A motion of one body: root places and joint quaternions (wxyz) of every frame, and where a frame is missing. */
class Track {
  constructor(entry, parents) {
    this.parents = parents;
    this.joints = parents.length;
    this.offsets = entry.offsets;
    this.limbs = entry.limbs;
    this.root = unpack(entry.root, Float32Array);
    this.frames = this.root.length / 3;
    this.present = unpack(entry.present, Uint8Array);
    const turns = unpack(entry.rotvecs, Int16Array);
    this.quats = new Float32Array(this.frames * this.joints * JOINT_FLOATS);
    for (let i = 0; i < this.frames * this.joints; i++) {
      const x = turns[3 * i] * entry.scale, y = turns[3 * i + 1] * entry.scale, z = turns[3 * i + 2] * entry.scale;
      const angle = Math.hypot(x, y, z);
      const k = angle < 1e-6 ? 0.5 : Math.sin(angle / 2) / angle;
      this.quats.set([Math.cos(angle / 2), k * x, k * y, k * z], JOINT_FLOATS * i);
    }
  }

  /** World positions (3 a joint) and rotations (9 a joint, row by row) at a frame that may lie between two. */
  pose(frame) {
    const first = Math.min(Math.max(Math.floor(frame), 0), this.frames - 1);
    const second = Math.min(first + 1, this.frames - 1);
    const t = Math.min(Math.max(frame - first, 0), 1);
    const positions = new Float32Array(3 * this.joints), rotations = new Float32Array(9 * this.joints);
    const local = new Float32Array(9);
    for (let j = 0; j < this.joints; j++) {
      this.turn(first, second, t, j, local);
      const parent = this.parents[j];
      if (parent < 0) {
        for (let a = 0; a < 3; a++) positions[a] = (1 - t) * this.root[3 * first + a] + t * this.root[3 * second + a];
        rotations.set(local, 0);
        continue;
      }
      const offset = this.offsets[j];
      for (let a = 0; a < 3; a++) {
        const r0 = rotations[9 * parent + 3 * a], r1 = rotations[9 * parent + 3 * a + 1], r2 = rotations[9 * parent + 3 * a + 2];
        positions[3 * j + a] = positions[3 * parent + a] + r0 * offset[0] + r1 * offset[1] + r2 * offset[2];
        for (let b = 0; b < 3; b++) rotations[9 * j + 3 * a + b] = r0 * local[b] + r1 * local[3 + b] + r2 * local[6 + b];
      }
    }
    return { positions, rotations };
  }

  /** The local rotation matrix of one joint between two frames. */
  turn(first, second, t, joint, out) {
    const a = JOINT_FLOATS * (first * this.joints + joint), b = JOINT_FLOATS * (second * this.joints + joint);
    const q = this.quats;
    const sign = q[a] * q[b] + q[a + 1] * q[b + 1] + q[a + 2] * q[b + 2] + q[a + 3] * q[b + 3] < 0 ? -1 : 1;
    let w = (1 - t) * q[a] + t * sign * q[b], x = (1 - t) * q[a + 1] + t * sign * q[b + 1];
    let y = (1 - t) * q[a + 2] + t * sign * q[b + 2], z = (1 - t) * q[a + 3] + t * sign * q[b + 3];
    const size = Math.hypot(w, x, y, z);
    w /= size; x /= size; y /= size; z /= size;
    out[0] = 1 - 2 * (y * y + z * z); out[1] = 2 * (x * y - w * z); out[2] = 2 * (x * z + w * y);
    out[3] = 2 * (x * y + w * z); out[4] = 1 - 2 * (x * x + z * z); out[5] = 2 * (y * z - w * x);
    out[6] = 2 * (x * z - w * y); out[7] = 2 * (y * z + w * x); out[8] = 1 - 2 * (x * x + y * y);
  }

  /** Root place averaged over about a second, for the camera to follow without shaking. */
  middle(frame, halfWidth) {
    const from = Math.max(0, Math.floor(frame - halfWidth)), to = Math.min(this.frames - 1, Math.ceil(frame + halfWidth));
    const sum = [0, 0, 0];
    let total = 0;
    for (let f = from; f <= to; f++) {
      const weight = Math.max(0, 1 - Math.abs(f - frame) / (halfWidth + 1));
      for (let a = 0; a < 3; a++) sum[a] += weight * this.root[3 * f + a];
      total += weight;
    }
    return sum.map((value) => value / total);
  }
}

/** Angle in degrees between the world rotations of each bone in two poses. */
function bone_angles(first, second, joints) {
  const angles = new Float32Array(joints);
  for (let j = 0; j < joints; j++) {
    let trace = 0;
    for (let i = 0; i < 9; i++) trace += first.rotations[9 * j + i] * second.rotations[9 * j + i];
    angles[j] = (Math.acos(Math.min(1, Math.max(-1, (trace - 1) / 2))) * 180) / Math.PI;
  }
  return angles;
}

/** Limbs of a pose in the world, `LIMB_FLOATS` numbers each; `colours` is one colour, or one a joint. */
function place_limbs(track, pose, colours) {
  const out = new Float32Array(LIMB_FLOATS * track.limbs.length);
  const single = typeof colours[0] === "number";
  track.limbs.forEach((limb, i) => {
    const bone = limb[0], R = pose.rotations, at = LIMB_FLOATS * i;
    for (let a = 0; a < 3; a++) {
      const r0 = R[9 * bone + 3 * a], r1 = R[9 * bone + 3 * a + 1], r2 = R[9 * bone + 3 * a + 2], p = pose.positions[3 * bone + a];
      out[at + a] = p + r0 * limb[1] + r1 * limb[2] + r2 * limb[3];
      out[at + 3 + a] = p + r0 * limb[4] + r1 * limb[5] + r2 * limb[6];
      out[at + 6 + a] = r0 * limb[7] + r1 * limb[8] + r2 * limb[9];
    }
    for (let a = 0; a < 4; a++) out[at + 9 + a] = limb[10 + a];
    out.set(single ? colours : colours[bone], at + 13);
  });
  return out;
}

// --- camera ---------------------------------------------------------------------------------------------------------

const multiply4 = (a, b) => {
  const out = new Float32Array(16); // column by column
  for (let c = 0; c < 4; c++) for (let r = 0; r < 4; r++) {
    let sum = 0;
    for (let k = 0; k < 4; k++) sum += a[4 * k + r] * b[4 * c + k];
    out[4 * c + r] = sum;
  }
  return out;
};

class Camera {
  constructor() { this.yaw = 0.6; this.pitch = 0.16; this.distance = 4.0; this.field = 0.5; }

  turn(dx, dy) {
    this.yaw -= dx;
    this.pitch = Math.min(1.45, Math.max(-0.02, this.pitch + dy));
  }

  zoom(factor) { this.distance = Math.min(14, Math.max(1.5, this.distance * factor)); }

  /** Eye and view-projection matrix for a target and a picture's width / height. */
  look(target, aspect) {
    const back = [Math.sin(this.yaw) * Math.cos(this.pitch), Math.sin(this.pitch), Math.cos(this.yaw) * Math.cos(this.pitch)];
    // A narrow panel must hold the body's width too.
    const distance = this.distance * Math.max(1, 0.62 / aspect);
    const eye = target.map((value, a) => value + distance * back[a]);
    const right = [Math.cos(this.yaw), 0, -Math.sin(this.yaw)];
    const up = [
      back[1] * right[2] - back[2] * right[1], back[2] * right[0] - back[0] * right[2], back[0] * right[1] - back[1] * right[0],
    ];
    const dot = (u) => -(u[0] * eye[0] + u[1] * eye[1] + u[2] * eye[2]);
    const view = [
      right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0, dot(right), dot(up), dot(back), 1,
    ];
    const f = 1 / Math.tan(this.field / 2), near = 0.1, far = 60;
    const project = [f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, (2 * far * near) / (near - far), 0];
    return { eye, right, up, back, distance, matrix: multiply4(project, view) };
  }
}

// --- WebGL ----------------------------------------------------------------------------------------------------------

const LIMB_VERTEX = `#version 300 es
layout(location=0) in vec4 shape;   // along the cap, ring size, which end, angle
layout(location=1) in vec3 start; layout(location=2) in vec3 end; layout(location=3) in vec3 side;
layout(location=4) in vec4 radii; layout(location=5) in vec3 colour;
uniform mat4 camera; uniform vec3 light; uniform float shadow;
out vec3 normal; out vec3 place; out vec3 paint;
void main() {
  vec3 axis = normalize(end - start), depth = cross(axis, side);
  vec2 r = mix(radii.xy, radii.zw, shape.z);
  float cap = min(r.x, r.y);
  vec2 ring = shape.y * vec2(cos(shape.w), sin(shape.w));
  place = mix(start, end, shape.z) + axis * (shape.x * cap) + side * (ring.x * r.x) + depth * (ring.y * r.y);
  float taper = dot(radii.xy - radii.zw, vec2(0.5)) / length(end - start) * shape.y / cap;
  normal = axis * (shape.x / cap + taper) + side * (ring.x / r.x) + depth * (ring.y / r.y);
  if (shadow > 0.5) place = vec3(place.xz - light.xz * (max(place.y, 0.0) / light.y), 0.002).xzy;
  paint = colour;
  gl_Position = camera * vec4(place, 1.0);
}`;
const LIMB_FRAGMENT = `#version 300 es
precision highp float;
in vec3 normal; in vec3 place; in vec3 paint;
uniform vec3 eye; uniform vec3 light; uniform float shadow; uniform float alpha;
out vec4 colour;
void main() {
  if (shadow > 0.5) { colour = vec4(0.10, 0.13, 0.20, alpha); return; }
  vec3 n = normalize(normal), v = normalize(eye - place), h = normalize(light + v);
  float lit = pow(0.5 + 0.5 * dot(n, light), 1.6), sky = 0.5 + 0.5 * n.y;
  float rim = pow(1.0 - max(dot(n, v), 0.0), 3.0), gloss = pow(max(dot(n, h), 0.0), 40.0);
  vec3 c = paint * (0.30 + 0.28 * sky + 0.62 * lit) + 0.10 * gloss + 0.10 * rim * sky;
  colour = vec4(c, alpha);
}`;
const GROUND_VERTEX = `#version 300 es
layout(location=0) in vec2 corner;
uniform mat4 camera; uniform vec3 centre;
out vec2 place;
void main() { place = centre.xz + corner * 16.0; gl_Position = camera * vec4(place.x, 0.0, place.y, 1.0); }`;
const GROUND_FRAGMENT = `#version 300 es
precision highp float;
in vec2 place; uniform vec3 centre; out vec4 colour;
float line(float spacing, float width) {
  vec2 at = place / spacing, near = abs(fract(at - 0.5) - 0.5) / fwidth(at);
  return 1.0 - smoothstep(width - 0.6, width + 0.6, min(near.x, near.y));
}
void main() {
  float far = length(place - centre.xz), fade = 1.0 - smoothstep(2.0, 9.0, far);
  vec2 tile = floor(place); // squares of a metre
  float checker = mod(tile.x + tile.y, 2.0);
  vec3 floor_ = mix(vec3(0.925, 0.935, 0.95), vec3(0.895, 0.908, 0.93), checker);
  floor_ = mix(floor_, vec3(0.70, 0.735, 0.79), 0.7 * line(1.0, 0.75));
  colour = vec4(mix(vec3(0.957, 0.963, 0.973), floor_, fade), 1.0);
}`;
const BACKGROUND = [0.957, 0.963, 0.973];
const LIGHT = (() => { const v = [0.35, 0.86, 0.38], s = Math.hypot(...v); return v.map((x) => x / s); })();

/** Ring by ring from pole to pole: half an ellipsoid, the tube, the other half. */
function limb_mesh(around, rings) {
  const profile = [];
  for (let i = 0; i <= rings; i++) { const a = (i / rings) * (Math.PI / 2); profile.push([-Math.cos(a), Math.sin(a), 0]); }
  for (let i = rings; i >= 0; i--) { const a = (i / rings) * (Math.PI / 2); profile.push([Math.cos(a), Math.sin(a), 1]); }
  const vertices = [], faces = [];
  profile.forEach(([along, size, end], i) => {
    for (let k = 0; k < around; k++) {
      vertices.push(along, size, end, (2 * Math.PI * k) / around);
      if (i === 0) continue;
      const a = (i - 1) * around + k, b = (i - 1) * around + ((k + 1) % around);
      faces.push(a, b, a + around, b, b + around, a + around);
    }
  });
  return { vertices: new Float32Array(vertices), faces: new Uint16Array(faces) };
}

class WebglPainter {
  constructor(canvas) {
    const gl = canvas.getContext("webgl2", { antialias: true, stencil: true, alpha: false });
    if (!gl) throw new Error("no WebGL 2");
    this.gl = gl;
    this.limb = this.program(LIMB_VERTEX, LIMB_FRAGMENT, ["camera", "light", "shadow", "eye", "alpha"]);
    this.ground = this.program(GROUND_VERTEX, GROUND_FRAGMENT, ["camera", "centre"]);
    const mesh = limb_mesh(32, 7);
    this.faces = mesh.faces.length;
    this.limbArray = gl.createVertexArray();
    gl.bindVertexArray(this.limbArray);
    this.buffer(gl.ARRAY_BUFFER, mesh.vertices);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 4, gl.FLOAT, false, 0, 0);
    this.buffer(gl.ELEMENT_ARRAY_BUFFER, mesh.faces);
    this.limbs = this.buffer(gl.ARRAY_BUFFER, new Float32Array(LIMB_FLOATS));
    let offset = 0;
    [3, 3, 3, 4, 3].forEach((size, i) => {
      gl.enableVertexAttribArray(i + 1);
      gl.vertexAttribPointer(i + 1, size, gl.FLOAT, false, 4 * LIMB_FLOATS, offset);
      gl.vertexAttribDivisor(i + 1, 1);
      offset += 4 * size;
    });
    this.groundArray = gl.createVertexArray();
    gl.bindVertexArray(this.groundArray);
    this.buffer(gl.ARRAY_BUFFER, new Float32Array([-1, -1, 1, -1, -1, 1, 1, 1]));
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 2, gl.FLOAT, false, 0, 0);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.SCISSOR_TEST);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
  }

  buffer(kind, data) {
    const buffer = this.gl.createBuffer();
    this.gl.bindBuffer(kind, buffer);
    this.gl.bufferData(kind, data, this.gl.DYNAMIC_DRAW);
    return buffer;
  }

  program(vertex, fragment, uniforms) {
    const gl = this.gl, program = gl.createProgram();
    [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]].forEach(([kind, source]) => {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(program, shader);
    });
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    return { program, at: Object.fromEntries(uniforms.map((name) => [name, gl.getUniformLocation(program, name)])) };
  }

  /** One panel: box in device pixels from the lower left; bodies as {limbs, alpha}. */
  paint(box, view, target, bodies) {
    const gl = this.gl;
    gl.viewport(...box);
    gl.scissor(...box);
    gl.clearColor(...BACKGROUND, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
    gl.useProgram(this.ground.program);
    gl.uniformMatrix4fv(this.ground.at.camera, false, view.matrix);
    gl.uniform3fv(this.ground.at.centre, target);
    gl.bindVertexArray(this.groundArray);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    gl.useProgram(this.limb.program);
    gl.uniformMatrix4fv(this.limb.at.camera, false, view.matrix);
    gl.uniform3fv(this.limb.at.eye, view.eye);
    gl.uniform3fv(this.limb.at.light, LIGHT);
    gl.bindVertexArray(this.limbArray);
    bodies.forEach((body) => this.shade(body));
    bodies.forEach((body) => this.body(body));
  }

  draw(body) {
    const gl = this.gl;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.limbs);
    gl.bufferData(gl.ARRAY_BUFFER, body.limbs, gl.DYNAMIC_DRAW);
    gl.drawElementsInstanced(gl.TRIANGLES, this.faces, gl.UNSIGNED_SHORT, 0, body.limbs.length / LIMB_FLOATS);
  }

  // The stencil lets each ground pixel darken once, however many limbs throw their shadow on it.
  shade(body) {
    const gl = this.gl;
    gl.enable(gl.BLEND); gl.enable(gl.STENCIL_TEST); gl.depthMask(false);
    gl.stencilFunc(gl.EQUAL, 0, 255); gl.stencilOp(gl.KEEP, gl.KEEP, gl.INCR);
    gl.uniform1f(this.limb.at.shadow, 1); gl.uniform1f(this.limb.at.alpha, 0.17 * body.alpha);
    this.draw(body);
    gl.disable(gl.BLEND); gl.disable(gl.STENCIL_TEST); gl.depthMask(true);
    gl.uniform1f(this.limb.at.shadow, 0);
  }

  // A translucent body is drawn into the depth first, so that only its outer skin is seen.
  body(body) {
    const gl = this.gl;
    gl.uniform1f(this.limb.at.alpha, body.alpha);
    if (body.alpha < 1) {
      gl.colorMask(false, false, false, false);
      this.draw(body);
      gl.colorMask(true, true, true, true);
      gl.enable(gl.BLEND); gl.depthFunc(gl.LEQUAL);
    }
    this.draw(body);
    gl.disable(gl.BLEND); gl.depthFunc(gl.LESS);
  }
}

// --- without WebGL: the same limbs as shaded strokes -----------------------------------------------------------------

class FlatPainter {
  constructor(canvas) { this.canvas = canvas; this.context = canvas.getContext("2d"); }

  paint(box, view, target, bodies) {
    const [left, bottom, width, height] = box, context = this.context, top = this.canvas.height - bottom - height;
    const m = view.matrix;
    const project = (p) => {
      const w = m[3] * p[0] + m[7] * p[1] + m[11] * p[2] + m[15];
      const x = m[0] * p[0] + m[4] * p[1] + m[8] * p[2] + m[12], y = m[1] * p[0] + m[5] * p[1] + m[9] * p[2] + m[13];
      return [left + (0.5 + (0.5 * x) / w) * width, top + (0.5 - (0.5 * y) / w) * height, w];
    };
    const pixels = height / 2 / Math.tan(0.25);
    const css = (c, k) => `rgb(${c.map((v) => Math.round(255 * Math.min(1, v * k))).join(",")})`;
    context.save();
    context.beginPath(); context.rect(left, top, width, height); context.clip();
    context.fillStyle = css(BACKGROUND, 1); context.fillRect(left, top, width, height);
    context.strokeStyle = "#c3cbd8"; context.lineWidth = 1;
    const x0 = Math.round(target[0]), z0 = Math.round(target[2]);
    for (let i = -3; i <= 3; i++) {
      [[[x0 + i, 0, z0 - 3], [x0 + i, 0, z0 + 3]], [[x0 - 3, 0, z0 + i], [x0 + 3, 0, z0 + i]]].forEach(([a, b]) => {
        const p = project(a), q = project(b);
        if (p[2] > 0.1 && q[2] > 0.1) { context.beginPath(); context.moveTo(p[0], p[1]); context.lineTo(q[0], q[1]); context.stroke(); }
      });
    }
    context.lineCap = "round";
    bodies.forEach((body) => {
      const strokes = [];
      for (let i = 0; i < body.limbs.length; i += LIMB_FLOATS) {
        const limb = body.limbs.subarray(i, i + LIMB_FLOATS);
        const p = project(limb.subarray(0, 3)), q = project(limb.subarray(3, 6));
        strokes.push({ p, q, far: p[2] + q[2], radius: (limb[9] + limb[10] + limb[11] + limb[12]) / 4, colour: Array.from(limb.subarray(13, 16)) });
      }
      context.globalAlpha = body.alpha;
      strokes.sort((a, b) => b.far - a.far).forEach(({ p, q, radius, colour }) => {
        const width_ = (4 * radius * pixels) / (p[2] + q[2]);
        [[1, 0.62], [0.82, 0.92], [0.45, 1.06]].forEach(([part, k]) => {
          context.strokeStyle = css(colour, k); context.lineWidth = part * width_;
          context.beginPath(); context.moveTo(p[0], p[1]); context.lineTo(q[0] + 0.01, q[1]); context.stroke();
        });
      });
    });
    context.restore();
  }
}

function make_painter(canvas) {
  if (!location.hash.includes("flat")) {
    try { return new WebglPainter(canvas); } catch (error) { console.info(`drawing flat: ${error.message}`); }
    // A canvas that once gave another context gives no 2D one.
    const fresh = canvas.cloneNode();
    canvas.replaceWith(fresh);
    return new FlatPainter(fresh);
  }
  return new FlatPainter(canvas);
}

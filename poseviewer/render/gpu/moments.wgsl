// The moments of many poses at once: depth, then the face of that depth, then attributes and sums.
// Vertices are snapped and edges tested as by the software renderer, see `software/rasterise.py`.

struct Pose {
    camera: array<f32, 17>, // rotation, translation, fx, fy, cx, cy, least z (0: parallel)
    weighs: f32, // times a corner's depth value is its weight; negative: all weigh 1
    left: i32, // the box that the model is in, px; from entry `at` on the picture buffers hold it
    top: i32,
    width: i32,
    height: i32,
    at: u32,
}

struct Params {
    phase: u32, // of `draw`: 0 depth, 1 faces
    faces: u32,
    levels: u32, // of each texture
    photo_width: u32,
    has_edges: u32, // and classes
}

struct Face {
    x: vec3<i32>, // corners, 1/256 px
    y: vec3<i32>,
    z: vec3<f32>, // their depth values
    sign: i32, // -1: a front; 0: without area
    area: f32, // twice, in (1/256 px)^2
    is_wide: bool, // edge functions do not fit into 32 bits
}

struct Surface {
    colour: vec3<f32>,
    normal: vec3<f32>, // unit, in the model's frame
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> poses: array<Pose>;
@group(0) @binding(2) var<storage, read> vertices: array<f32>; // place, normal, RGB, UV
@group(0) @binding(3) var<storage, read> faces: array<i32>; // corners, texture, bits of texel area
@group(0) @binding(4) var<storage, read> texels: array<f32>;
@group(0) @binding(5) var<storage, read> table: array<u32>; // of each level: offset, width, height
@group(0) @binding(6) var<storage, read> photo: array<f32>; // F (3), weight, class, edges (2)
@group(0) @binding(7) var<storage, read_write> depths: array<atomic<u32>>;
@group(0) @binding(8) var<storage, read_write> ids: array<atomic<u32>>; // ~face; 0: none
@group(0) @binding(9) var<storage, read_write> field: array<vec2<f32>>;
@group(0) @binding(10) var<storage, read_write> sums: array<f32>;

const LANES = 64u;
const DRAWN_ALONE = 16; // px of its box up to which a thread draws its face alone
const SMALL = 16384; // 64 px
const TILE = vec2<i32>(16, 8);
const PIXELS = 128u;
const RIM = 52u;
const SPAN = 18u; // columns of a tile with its rim
const STRIDE = 7u; // numbers for each pixel of the photo
const ATTRIBUTES = 6u; // M: R, G, B, grey times normal
const SLOTS = 11u; // F (3), M (6), 1, weight
const FIRST = 3u;
const ONE = 9u;
const WEIGHT = 10u;
// What a group gives: origin of M, products of all slots but the weight, the number of pixels, by
// class the sums of M and 1, and two sums over edges.
const PRODUCTS = 100u;
const TERMS = 213u;
const RECORD = 221u;
const ANY_CLASS = 255u;
const SHOWN = 128u;
const NOTHING = 129u;
const GREY = vec3<f32>({grey});
const TAPS = array<f32, 9>({taps});
const NOISE = {noise}; // 64 times the square of the gradient below which there is no edge

fn corner(pose: u32, vertex: u32) -> vec3<i32> {
    let m = &poses[pose].camera;
    let at = 11u * vertex;
    let x = vertices[at];
    let y = vertices[at + 1u];
    let z = vertices[at + 2u];
    let distance = (*m)[6] * x + (*m)[7] * y + (*m)[8] * z + (*m)[11];
    let is_perspective = (*m)[16] > 0.0;
    let d = select(-distance, 1.0 / max(distance, (*m)[16]), is_perspective);
    let share = select(1.0, d, is_perspective);
    let across = (*m)[12] * ((*m)[0] * x + (*m)[1] * y + (*m)[2] * z + (*m)[9]);
    let down = (*m)[13] * ((*m)[3] * x + (*m)[4] * y + (*m)[5] * z + (*m)[10]);
    let place = vec2<f32>(across * share + (*m)[14], down * share + (*m)[15]);
    return vec3<i32>(vec2<i32>(floor(place * 256.0 + 0.5)), bitcast<i32>(d));
}

// a b in 64 bits, low and high.
fn product(a: i32, b: i32) -> vec2<u32> {
    let p = u32(abs(a));
    let q = u32(abs(b));
    let low = (p & 0xffffu) * (q & 0xffffu);
    let one = (p >> 16u) * (q & 0xffffu);
    let middle = one + (p & 0xffffu) * (q >> 16u) + (low >> 16u); // factors have 30 bits
    let found = vec2<u32>((middle << 16u) | (low & 0xffffu), (p >> 16u) * (q >> 16u) + (middle >> 16u));
    return select(found, negative(found), (a < 0) != (b < 0));
}

fn negative(a: vec2<u32>) -> vec2<u32> {
    return vec2<u32>(~a.x + 1u, ~a.y + select(0u, 1u, a.x == 0u));
}

// a b - c d
fn cross64(a: i32, b: i32, c: i32, d: i32) -> vec2<u32> {
    let p = product(a, b);
    let q = negative(product(c, d));
    let low = p.x + q.x;
    return vec2<u32>(low, p.y + q.y + select(0u, 1u, low < p.x));
}

fn real(a: vec2<u32>) -> f32 {
    return f32(bitcast<i32>(a.y)) * 4294967296.0 + f32(a.x);
}

fn face_of(pose: u32, face: u32) -> Face {
    var f: Face;
    let a = corner(pose, u32(faces[5u * face]));
    let b = corner(pose, u32(faces[5u * face + 1u]));
    let c = corner(pose, u32(faces[5u * face + 2u]));
    f.x = vec3<i32>(a.x, b.x, c.x);
    f.y = vec3<i32>(a.y, b.y, c.y);
    f.z = bitcast<vec3<f32>>(vec3<i32>(a.z, b.z, c.z));
    let size = max(max(a.xy, b.xy), c.xy) - min(min(a.xy, b.xy), c.xy);
    f.is_wide = max(size.x, size.y) > SMALL;
    let p = b.xy - a.xy;
    let q = c.xy - a.xy;
    if f.is_wide {
        let area = cross64(p.x, q.y, q.x, p.y);
        f.sign = select(select(1, -1, (area.y >> 31u) == 1u), 0, area.x == 0u && area.y == 0u);
        f.area = abs(real(area));
    } else {
        let area = p.x * q.y - q.x * p.y;
        f.sign = sign(area);
        f.area = f32(abs(area));
    }
    return f;
}

// The edge functions at a pixel, and whether the face has it by the top-left rule.
fn edges_at(f: Face, column: i32, row: i32) -> vec4<f32> {
    let ex = f.sign * (f.x.zxy - f.x.yzx);
    let ey = f.sign * (f.y.zxy - f.y.yzx);
    let px = column * 256 + 128 - f.x.yzx;
    let py = row * 256 + 128 - f.y.yzx;
    let is_top_left = (ey < vec3<i32>(0)) | ((ey == vec3<i32>(0)) & (ex > vec3<i32>(0)));
    if !f.is_wide {
        let e = ex * py - ey * px;
        let has = all(e - select(vec3<i32>(1), vec3<i32>(0), is_top_left) >= vec3<i32>(0));
        return vec4<f32>(vec3<f32>(e), f32(has));
    }
    var e: vec3<f32>;
    var has = true;
    for (var k = 0; k < 3; k++) {
        let wide = cross64(ex[k], py[k], ey[k], px[k]);
        let is_zero = wide.x == 0u && wide.y == 0u;
        has = has && (wide.y >> 31u) == 0u && (is_top_left[k] || !is_zero);
        e[k] = real(wide);
    }
    return vec4<f32>(e, f32(has));
}

// Columns and rows whose pixel centres the face's box holds: left, top, right, bottom, ends included.
fn box_of(pose: u32, f: Face) -> vec4<i32> {
    let p = &poses[pose];
    let low = vec2<i32>(min(min(f.x.x, f.x.y), f.x.z), min(min(f.y.x, f.y.y), f.y.z));
    let high = vec2<i32>(max(max(f.x.x, f.x.y), f.x.z), max(max(f.y.x, f.y.y), f.y.z));
    let first = vec2<i32>((*p).left, (*p).top);
    let last = first + vec2<i32>((*p).width, (*p).height) - 1;
    return vec4<i32>(
        max((low + 127) >> vec2<u32>(8u), first), min((high - 128) >> vec2<u32>(8u), last));
}

fn put(pose: u32, column: i32, row: i32, d: f32, face: u32) {
    let p = &poses[pose];
    let at = (*p).at + u32((row - (*p).top) * (*p).width + column - (*p).left);
    let bits = bitcast<u32>(d);
    let key = select(bits | 0x80000000u, ~bits, (bits >> 31u) == 1u); // as the numbers are ordered
    if params.phase == 0u {
        atomicMax(&depths[at], key);
    } else if atomicLoad(&depths[at]) == key {
        atomicMax(&ids[at], ~face);
    }
}

// What of a face is in every `step`-th column of its box from the `first` on.
fn draw_columns(pose: u32, face: u32, f: Face, box: vec4<i32>, first: u32, step: u32) {
    let low = min(min(f.z.x, f.z.y), f.z.z);
    let high = max(max(f.z.x, f.z.y), f.z.z);
    for (var column = box.x + i32(first); column <= box.z; column += i32(step)) {
        for (var row = box.y; row <= box.w; row++) {
            let e = edges_at(f, column, row);
            if e.w > 0.0 {
                let d = f.z.x + e.y / f.area * (f.z.y - f.z.x) + e.z / f.area * (f.z.z - f.z.x);
                put(pose, column, row, clamp(d, low, high), face);
            }
        }
    }
}

var<workgroup> is_left: array<u32, LANES>; // faces that are too large for one thread

@compute @workgroup_size(LANES)
fn draw(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let face = LANES * group.x + lane;
    let pose = group.y;
    is_left[lane] = 0u;
    if face < params.faces {
        let f = face_of(pose, face);
        let box = box_of(pose, f);
        let size = box.zw - box.xy + 1;
        if min(size.x, size.y) > 0 && f.sign != 0 {
            if max(size.x, size.y) <= DRAWN_ALONE && size.x * size.y <= DRAWN_ALONE {
                draw_columns(pose, face, f, box, 0u, 1u);
            } else {
                is_left[lane] = 1u;
            }
        }
    }
    workgroupBarrier();
    for (var k = 0u; k < LANES; k++) { // these by all threads, a column each
        if is_left[k] == 0u {
            continue;
        }
        let large = LANES * group.x + k;
        let f = face_of(pose, large);
        draw_columns(pose, large, f, box_of(pose, f), lane, LANES);
    }
}

fn texel(at: u32) -> vec3<f32> {
    return vec3<f32>(texels[3u * at], texels[3u * at + 1u], texels[3u * at + 2u]);
}

fn sampled(texture: i32, level: u32, uv: vec2<f32>) -> vec3<f32> {
    let entry = 3u * (u32(texture) * params.levels + level);
    let offset = table[entry];
    let size = vec2<i32>(i32(table[entry + 1u]), i32(table[entry + 2u]));
    var part = uv - floor(uv);
    part.y = 1.0 - part.y;
    let place = part * vec2<f32>(size) - 0.5;
    let share = place - floor(place);
    let low = (vec2<i32>(floor(place)) + size) % size;
    let high = (low + 1) % size;
    let upper = offset + u32(low.y * size.x);
    let lower = offset + u32(high.y * size.x);
    return mix(
        mix(texel(upper + u32(low.x)), texel(upper + u32(high.x)), share.x),
        mix(texel(lower + u32(low.x)), texel(lower + u32(high.x)), share.x),
        share.y);
}

// Three of a corner's numbers, in `vertices` from `first` on.
fn of_corner(face: u32, k: u32, first: u32) -> vec3<f32> {
    let at = 11u * u32(faces[5u * face + k]) + first;
    return vec3<f32>(vertices[at], vertices[at + 1u], vertices[at + 2u]);
}

// What corners that are not snapped weigh at a pixel, negative where a front is seen; homogeneous: x = X - u W, y = Y - v W.
fn exact_weights(pose: u32, face: u32, column: i32, row: i32) -> vec3<f32> {
    let m = &poses[pose].camera;
    var x: vec3<f32>;
    var y: vec3<f32>;
    for (var k = 0u; k < 3u; k++) {
        let p = of_corner(face, k, 0u);
        let across = dot(vec3<f32>((*m)[0], (*m)[1], (*m)[2]), p) + (*m)[9];
        let down = dot(vec3<f32>((*m)[3], (*m)[4], (*m)[5]), p) + (*m)[10];
        let distance = dot(vec3<f32>((*m)[6], (*m)[7], (*m)[8]), p) + (*m)[11];
        let w = select(1.0, distance, (*m)[16] > 0.0);
        x[k] = (*m)[12] * across + ((*m)[14] - f32(column) - 0.5) * w;
        y[k] = (*m)[13] * down + ((*m)[15] - f32(row) - 0.5) * w;
    }
    return cross(x, y);
}

// What a face shows at a pixel.
fn shaded(pose: u32, face: u32, column: i32, row: i32) -> Surface {
    let f = face_of(pose, face);
    let weighs = select(vec3<f32>(1.0), f.z, poses[pose].weighs > 0.0);
    let snapped = f32(f.sign) * edges_at(f, column, row).xyz * weighs;
    let w = select(snapped, exact_weights(pose, face, column, row), f.is_wide);
    let total = w.x + w.y + w.z;
    let shares = w / total;
    let texture = faces[5u * face + 3u];
    var seen: Surface;
    var uv: vec2<f32>;
    for (var k = 0u; k < 3u; k++) {
        seen.normal += shares[k] * of_corner(face, k, 3u);
        seen.colour += shares[k] * of_corner(face, k, 6u);
        uv += shares[k] * of_corner(face, k, 8u).yz;
    }
    let side = -sign(total) / sqrt(max(dot(seen.normal, seen.normal), 1e-30));
    seen.normal *= side; // to the side that is seen
    if texture >= 0 {
        let ratio = bitcast<f32>(faces[5u * face + 4u]) * 65536.0 / f.area;
        let level = select(0u, u32(0.5 * log2(max(ratio, 1.0)) + 0.5), ratio > 1.0);
        seen.colour *= sampled(texture, min(level, params.levels - 1u), uv);
    }
    seen.colour = clamp(seen.colour, vec3<f32>(0.0), vec3<f32>(1.0));
    return seen;
}

// ~face of a pixel, or 0.
fn id_at(pose: u32, column: i32, row: i32) -> u32 {
    let p = &poses[pose];
    let place = vec2<i32>(column - (*p).left, row - (*p).top);
    if any(place < vec2<i32>(0)) || place.x >= (*p).width || place.y >= (*p).height {
        return 0u;
    }
    return atomicLoad(&ids[(*p).at + u32(place.y * (*p).width + place.x)]);
}

var<workgroup> shown: array<vec4<f32>, 180>; // normal and grey of a tile with its rim
var<workgroup> covered: array<f32, 180>;
var<workgroup> values: array<f32, SLOTS * PIXELS>;
var<workgroup> labels: array<u32, PIXELS>;
var<workgroup> origin: array<f32, 6>;
var<workgroup> told: array<u32, PIXELS>; // a pixel that counts; SHOWN: none here; NOTHING is shown

// What a pixel shows, also into a place of the tile.
fn show(pose: u32, place: u32, at: vec2<i32>) -> Surface {
    let id = id_at(pose, at.x, at.y);
    var seen: Surface;
    if id != 0u {
        seen = shaded(pose, ~id, at.x, at.y);
    }
    shown[place] = vec4<f32>(seen.normal, dot(GREY, seen.colour));
    covered[place] = select(0.0, 1.0, id != 0u);
    return seen;
}

fn model_value(seen: Surface, index: u32) -> f32 {
    let lit = dot(GREY, seen.colour) * seen.normal[max(index, 3u) - 3u];
    return select(seen.colour[min(index, 2u)], lit, index > 2u);
}

// Sobel's operator on a tile: the orientation field at a place of `shown`.
fn orientation(place: u32) -> vec2<f32> {
    var across = vec4<f32>(0.0);
    var down = vec4<f32>(0.0);
    var outline = vec2<f32>(0.0);
    for (var k = 0u; k < 3u; k++) {
        let weight = select(1.0, 2.0, k == 1u);
        let row = place + k * SPAN - SPAN;
        let column = place + k - 1u;
        across += weight * (shown[row + 1u] - shown[row - 1u]);
        down += weight * (shown[column + SPAN] - shown[column - SPAN]);
        outline += weight * vec2<f32>(
            covered[row + 1u] - covered[row - 1u], covered[column + SPAN] - covered[column - SPAN]);
    }
    let xx = dot(across, across) + outline.x * outline.x;
    let yy = dot(down, down) + outline.y * outline.y;
    let xy = dot(across, down) + outline.x * outline.y;
    return vec2<f32>(xx - yy, 2.0 * xy) / (xx + yy + NOISE);
}

@compute @workgroup_size(16, 8)
fn shade(
    @builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32, @builtin(local_invocation_id) local: vec3<u32>,
) {
    let pose = group.y;
    let p = &poses[pose];
    let tiles = (vec2<i32>((*p).width, (*p).height) + TILE - 1) / TILE;
    let place = (local.y + 1u) * SPAN + local.x + 1u;
    var found = array<f32, 2>(0.0, 0.0);
    var has_origin = false;
    for (var tile = i32(group.x); tile < tiles.x * tiles.y; tile += i32(groups.x)) {
        let first = vec2<i32>((*p).left, (*p).top) + TILE * vec2<i32>(tile % tiles.x, tile / tiles.x);
        workgroupBarrier();
        let at = first + vec2<i32>(local.xy);
        let seen = show(pose, place, at);
        let pixel = STRIDE * (u32(at.y) * params.photo_width + u32(at.x));
        let mine = SLOTS * lane;
        var weight = 0.0;
        told[lane] = NOTHING;
        if covered[place] > 0.0 {
            weight = photo[pixel + 3u];
            told[lane] = select(SHOWN, lane, weight > 0.0);
        }
        if params.has_edges > 0u && lane < RIM {
            var rim = vec2<u32>(lane % SPAN, select(0u, 9u, lane >= SPAN));
            if lane >= 2u * SPAN {
                let k = lane - 2u * SPAN;
                rim = vec2<u32>(select(0u, SPAN - 1u, k >= 8u), 1u + k % 8u);
            }
            let other = rim.y * SPAN + rim.x;
            show(pose, other, first + vec2<i32>(rim) - 1);
            told[lane] = min(told[lane], select(NOTHING, SHOWN, covered[other] > 0.0));
        }
        for (var half = PIXELS / 2u; half > 0u; half /= 2u) {
            workgroupBarrier();
            if lane < half {
                told[lane] = min(told[lane], told[lane + half]);
            }
        }
        let teller = workgroupUniformLoad(&told[0]);
        if teller == NOTHING {
            continue;
        }
        let in_box = all(at < vec2<i32>((*p).left + (*p).width, (*p).top + (*p).height));
        if params.has_edges > 0u && in_box {
            field[(*p).at + u32((at.y - (*p).top) * (*p).width + at.x - (*p).left)] = orientation(place);
        }
        if teller == SHOWN {
            continue;
        }
        if !has_origin { // sums about what one pixel has keep their digits
            has_origin = true;
            if lane == teller {
                for (var k = 0u; k < ATTRIBUTES; k++) {
                    origin[k] = model_value(seen, k);
                }
            }
            workgroupBarrier();
        }
        values[mine + ONE] = 1.0;
        values[mine + WEIGHT] = weight;
        labels[lane] = 0u;
        for (var k = 0u; k < FIRST + ATTRIBUTES; k++) {
            values[mine + k] = 0.0;
        }
        if weight > 0.0 {
            labels[lane] = u32(photo[pixel + 4u]);
            for (var k = 0u; k < FIRST; k++) {
                values[mine + k] = photo[pixel + k];
            }
            for (var k = 0u; k < ATTRIBUTES; k++) {
                values[mine + FIRST + k] = model_value(seen, k) - origin[k];
            }
        }
        workgroupBarrier();
        for (var k = 0u; k < 2u; k++) {
            let term = k * PIXELS + lane;
            if term < select(PRODUCTS + 1u, TERMS, params.has_edges > 0u) {
                var one = ONE;
                var other = ONE;
                var of_class = ANY_CLASS;
                if term < PRODUCTS {
                    one = term / 10u;
                    other = term % 10u;
                } else if term > PRODUCTS {
                    other = FIRST + (term - PRODUCTS - 1u) % 7u;
                    of_class = (term - PRODUCTS - 1u) / 7u;
                }
                var total = 0.0;
                for (var begin = 0u; begin < PIXELS; begin += 16u) { // short sums round less
                    var part = 0.0;
                    for (var q = begin; q < begin + 16u; q++) {
                        let w = values[SLOTS * q + WEIGHT];
                        let counts = of_class == ANY_CLASS || labels[q] == of_class;
                        let share = select(w, select(0.0, 1.0, w > 0.0), term == PRODUCTS);
                        let more = share * values[SLOTS * q + one] * values[SLOTS * q + other];
                        part += select(0.0, more, counts);
                    }
                    total += part;
                }
                found[k] += total;
            }
        }
        workgroupBarrier();
    }
    let record = RECORD * (pose * groups.x + group.x);
    if lane < ATTRIBUTES {
        sums[record + lane] = select(0.0, origin[lane], has_origin);
    }
    for (var k = 0u; k < 2u; k++) {
        let term = k * PIXELS + lane;
        if term < TERMS {
            sums[record + ATTRIBUTES + term] = found[k];
        }
    }
}

var<workgroup> near: array<vec2<f32>, 1024>; // the field of a tile of 16 x 16 px, and 8 px around it
var<workgroup> rows: array<vec2<f32>, 512>; // blurred along rows
var<workgroup> parts: array<vec2<f32>, 256>;

@compute @workgroup_size(16, 16)
fn blur(
    @builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32, @builtin(local_invocation_id) local: vec3<u32>,
) {
    let pose = group.y;
    let p = &poses[pose];
    let size = vec2<i32>((*p).width, (*p).height);
    let tiles = (size + 15) / 16;
    var taps = TAPS;
    var found = vec2<f32>(0.0);
    for (var tile = i32(group.x); tile < tiles.x * tiles.y; tile += i32(groups.x)) {
        let first = 16 * vec2<i32>(tile % tiles.x, tile / tiles.x);
        for (var k = lane; k < 1024u; k += 256u) {
            let at = first + vec2<i32>(i32(k % 32u), i32(k / 32u)) - 8;
            near[k] = vec2<f32>(0.0);
            if all(at >= vec2<i32>(0)) && all(at < size) {
                near[k] = field[(*p).at + u32(at.y * size.x + at.x)];
            }
        }
        workgroupBarrier();
        for (var k = lane; k < 512u; k += 256u) {
            let middle = 32u * (k / 16u) + k % 16u + 8u;
            var total = taps[0] * near[middle];
            for (var tap = 1u; tap < 9u; tap++) {
                total += taps[tap] * (near[middle - tap] + near[middle + tap]);
            }
            rows[k] = total;
        }
        workgroupBarrier();
        let middle = 16u * (local.y + 8u) + local.x;
        var e = taps[0] * rows[middle];
        for (var tap = 1u; tap < 9u; tap++) {
            e += taps[tap] * (rows[middle - 16u * tap] + rows[middle + 16u * tap]);
        }
        let at = first + vec2<i32>(local.xy);
        if all(at < size) {
            let column = u32(at.x + (*p).left);
            let row = u32(at.y + (*p).top);
            let pixel = STRIDE * (row * params.photo_width + column) + 3u;
            let edges = vec2<f32>(photo[pixel + 2u], photo[pixel + 3u]);
            found += vec2<f32>(dot(e, edges), photo[pixel] * dot(e, e));
        }
    }
    parts[lane] = found;
    workgroupBarrier();
    for (var half = 128u; half > 0u; half /= 2u) {
        if lane < half {
            parts[lane] += parts[lane + half];
        }
        workgroupBarrier();
    }
    if lane < 2u {
        let record = RECORD * (pose * groups.x + group.x);
        sums[record + ATTRIBUTES + TERMS + lane] = parts[0][lane];
    }
}

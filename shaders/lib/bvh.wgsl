// Shadow rays through the flat BVH, with the watertight triangle test of Woop, Benthin & Wald 2013.
// Twin: crates/meshless_gi/src/scene/bvh.rs. Needs `nodes`, `triangles` and `bvh_nodes()`, the
// number of nodes.

const STACK: u32 = 64u;
const MIN_COMPONENT: f32 = 1e-18;

// Coordinate system of a ray, in which it runs along z.
struct Shear {
    // Indices of the axes that become x, y and z.
    axes: vec3u,
    s: vec3f,
}

fn shear_of(direction: vec3f) -> Shear {
    let a = abs(direction);
    var z = 2u;
    if a.x > a.y && a.x > a.z {
        z = 0u;
    } else if a.y > a.z {
        z = 1u;
    }
    var axes = vec3u((z + 1u) % 3u, (z + 2u) % 3u, z);
    if direction[z] < 0.0 {
        axes = axes.yxz;
    }
    return Shear(axes, vec3f(direction[axes.x], direction[axes.y], 1.0) / direction[z]);
}

fn sheared(shear: Shear, origin: vec3f, corner: vec3f) -> vec3f {
    let v = corner - origin;
    let z = v[shear.axes.z];
    return vec3f(v[shear.axes.x] - shear.s.x * z, v[shear.axes.y] - shear.s.y * z, shear.s.z * z);
}

fn intersects(shear: Shear, origin: vec3f, max_t: f32, triangle: BvhTriangle) -> bool {
    let a = sheared(shear, origin, triangle.a);
    let b = sheared(shear, origin, triangle.b);
    let c = sheared(shear, origin, triangle.c);
    let u = c.x * b.y - c.y * b.x;
    let v = a.x * c.y - a.y * c.x;
    let w = b.x * a.y - b.y * a.x;
    let outside = min(u, min(v, w)) < 0.0 && max(u, max(v, w)) > 0.0;
    let det = u + v + w;
    if outside || det == 0.0 {
        return false;
    }
    let t = (u * a.z + v * b.z + w * c.z) / det;
    return t > 0.0 && t < max_t;
}

// Transmittance along the ray with t in (0, max_t). It is 0 behind any static triangle. Otherwise
// it is the product of the transmittances of the occluders in between, each once.
fn transmittance_along(origin: vec3f, direction: vec3f, max_t: f32) -> f32 {
    if bvh_nodes() == 0u {
        return 1.0;
    }
    var transmittance = 1.0;
    // One bit per occluder.
    var crossed = vec2u(0u);
    // Finite, so that 0 · ∞ never occurs.
    let inverse = 1.0 / select(direction, vec3f(MIN_COMPONENT), abs(direction) < vec3f(MIN_COMPONENT));
    let shear = shear_of(direction);
    var stack: array<u32, 64>;
    stack[0] = 0u;
    var top = 1u;
    while top > 0u {
        top -= 1u;
        let node = nodes[stack[top]];
        let a = (node.min - origin) * inverse;
        let b = (node.max - origin) * inverse;
        let lower = min(a, b);
        let upper = max(a, b);
        let near = max(max(lower.x, max(lower.y, lower.z)), 0.0);
        let far = min(min(upper.x, min(upper.y, upper.z)), max_t);
        if near > far {
            continue;
        }
        if node.count == 0u {
            if top + 2u <= STACK {
                stack[top] = node.first;
                stack[top + 1u] = node.first + 1u;
                top += 2u;
            }
            continue;
        }
        for (var i = node.first; i < node.first + node.count; i++) {
            if !intersects(shear, origin, max_t, triangles[i]) {
                continue;
            }
            let occluder = triangles[i].occluder;
            if occluder == 0u {
                return 0.0;
            }
            let k = occluder - 1u;
            let bit = select(vec2u(0u, 1u), vec2u(1u, 0u), k % 64u < 32u) << vec2u(k % 32u);
            if all((crossed & bit) == vec2u(0u)) {
                crossed |= bit;
                transmittance *= triangles[i].transmittance;
            }
            if transmittance <= 0.0 {
                return 0.0;
            }
        }
    }
    return transmittance;
}

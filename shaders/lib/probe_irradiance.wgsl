// Irradiance of a probe. Twin: crates/meshless_gi/src/frame/probe.rs.

const PROBE_ROWS: u32 = 3u;

// E(n) = c + d·n + n·Q n: d; (c, Q_xx, Q_yy); (Q_xy, Q_xz, Q_yz).
struct ProbeIrradiance {
    linear: VectorIrradiance,
    even: VectorIrradiance,
    mixed: VectorIrradiance,
    reached: bool,
}

// E(n), clamped to zero.
fn probe_irradiance(light: ProbeIrradiance, n: vec3f) -> vec3f {
    let square = n * n;
    let e = light.even.x
        + light.even.y * (square.x - square.z)
        + light.even.z * (square.y - square.z)
        + 2.0 * (light.mixed.x * (n.x * n.y) + light.mixed.y * (n.x * n.z) + light.mixed.z * (n.y * n.z));
    return max(e.xyz + irradiance_dot(light.linear, n), vec3f(0.0));
}

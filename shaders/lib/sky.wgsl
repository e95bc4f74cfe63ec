
// Direct irradiance of a sender from the sky. `terms` is the sum of its sky terms times their
// coefficients.
fn sky_light(uniform_sky: vec3f, toward: f32, terms: vec3f, count: u32) -> vec3f {
    let e = uniform_sky * max(toward, 0.0);
    if count == 0u {
        return e;
    }
    // The series can be negative.
    return max(e + terms, vec3f(0.0));
}

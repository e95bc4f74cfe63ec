
// What a sender has straight from the sky. `terms` are its numbers of the sky's terms, summed up
// with their coefficients.
fn sky_light(uniform_sky: vec3f, toward: f32, terms: vec3f, count: u32) -> vec3f {
    let e = uniform_sky * max(toward, 0.0);
    if count == 0u {
        return e;
    }
    // The series may fall below zero.
    return max(e + terms, vec3f(0.0));
}

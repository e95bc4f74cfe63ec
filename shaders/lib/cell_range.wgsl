// Ranges of depth and normal in a cell. Twin: crates/meshless_gi/src/frame/pyramid.rs.

// `low` of a cell without a normal: `min` leaves other values unchanged.
const EMPTY_LOW: u32 = 0x007f7f7fu;

// The four signed bytes of a word.
fn signed_bytes(word: u32) -> vec4i {
    return vec4i(bitcast<i32>(word << 24u), bitcast<i32>(word << 16u), bitcast<i32>(word << 8u), bitcast<i32>(word)) >> vec4u(24u);
}

//! Errors of a device, with the values that caused them.

/// Reason why the kernels cannot run.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum GpuError {
    /// There is no graphics driver that can compute.
    #[error("no graphics adapter was found: {0}")]
    NoAdapter(String),
    /// The driver gave no device.
    #[error("the graphics adapter gave no device: {0}")]
    NoDevice(String),
    /// The device offers less than the kernels need.
    #[error("the device's {limit} is {have}, the kernels need {need}")]
    Limit {
        /// The limit's name in WebGPU.
        limit: &'static str,
        /// Value that the device offers.
        have: u64,
        /// Value that the kernels need.
        need: u64,
    },
    /// An array of the scene does not fit a binding.
    #[error("{what} takes {bytes} bytes, but the device binds at most {limit}")]
    TooLarge {
        /// Name of the array.
        what: &'static str,
        /// Size of the array, bytes.
        bytes: u64,
        /// Largest size of a binding, bytes.
        limit: u64,
    },
    /// The device did not return its results.
    #[error("reading back from the device failed: {0}")]
    ReadBack(String),
}

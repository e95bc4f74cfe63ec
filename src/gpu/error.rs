//! Errors of a device, with the values that caused them.

/// Reason why the kernels cannot run.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum GpuError {
    /// Missing graphics driver with compute support.
    #[error("no graphics adapter was found: {0}")]
    NoAdapter(String),
    /// Device request that the driver rejected.
    #[error("the graphics adapter gave no device: {0}")]
    NoDevice(String),
    /// Device limit below the requirement of the kernels.
    #[error("the device's {limit} is {have}, the kernels need {need}")]
    Limit {
        /// Name of the limit in WebGPU.
        limit: &'static str,
        /// Value that the device offers.
        have: u64,
        /// Value that the kernels need.
        need: u64,
    },
    /// Array of the scene that exceeds the size of a binding.
    #[error("{what} takes {bytes} bytes, but the device binds at most {limit}")]
    TooLarge {
        /// Name of the array.
        what: &'static str,
        /// Size of the array, bytes.
        bytes: u64,
        /// Largest size of a binding, bytes.
        limit: u64,
    },
    /// Failed read-back of results from the device.
    #[error("reading back from the device failed: {0}")]
    ReadBack(String),
}

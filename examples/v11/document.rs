//! The document: what was found, the tables, and the charts and pictures that it shows.
use super::Experiment;
use std::error::Error;

pub fn text(_: &Experiment) -> Result<String, Box<dyn Error>> {
    Ok(String::new())
}

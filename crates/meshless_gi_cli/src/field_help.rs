//! Help of the options that set fields of a recipe, from the fields' doc comments.

use clap::{Arg, ArgAction};
use documented::DocumentedFields;
use meshless_gi::{FmmRecipe, PcaRecipe, ProbeSettings, Recipe, VisibilityRecipe};

/// Sets the help of an option to the doc comment of the recipe's field that has the option's
/// identifier. Leaves other arguments unchanged.
pub fn field_help(argument: Arg) -> Arg {
    let doc = field_doc(argument.get_id().as_str());
    let (Some(doc), Some(_)) = (doc, argument.get_long()) else {
        return argument;
    };
    let mut help = words_of_tool(doc);
    if matches!(argument.get_action(), ArgAction::Append) {
        help.push_str(" Repeat the option for several.");
    }
    // Other options have no period at the end either.
    argument.help(help.trim_end_matches('.').to_string())
}

/// Returns the doc comment of a field. The fields of a group have its prefix.
fn field_doc(id: &str) -> Option<&'static str> {
    let doc = if let Some(field) = id.strip_prefix("pca_") {
        PcaRecipe::get_field_docs(field)
    } else if let Some(field) = id.strip_prefix("fmm_") {
        FmmRecipe::get_field_docs(field)
    } else if let Some(field) = id.strip_prefix("visibility_") {
        VisibilityRecipe::get_field_docs(field)
    } else if let Some(field) = id.strip_prefix("probe_") {
        ProbeSettings::get_field_docs(field)
    } else {
        Recipe::get_field_docs(id)
    };
    doc.ok()
}

/// Converts a doc comment to plain text. Code is in lower case, as values of options are.
fn words_of_tool(doc: &str) -> String {
    let parts = doc.split('`').enumerate().map(|(i, part)| match i % 2 {
        0 => part.replace('\\', ""),
        _ => part.replace("(..)", "").to_lowercase(),
    });
    let text: String = parts.collect();
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::words_of_tool;

    #[test]
    fn doc_comment_becomes_plain_text() {
        let doc = "Method: `Bounded` or\n `Pca(..)` (\\[L08\\]).";
        assert_eq!(words_of_tool(doc), "Method: bounded or pca ([L08]).");
    }
}

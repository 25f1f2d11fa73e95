//! A search over the vehicles: all its words stand somewhere in what is shown of one.

use serde::{Deserialize, Deserializer};
use telltale_web::texts::{NAME, clean};

use super::Row;

/// Words of a search; further ones are left out.
const WORDS_MAX: usize = 8;

#[derive(Debug, Clone, Default)]
pub struct Search {
    text: String,
    /// In small letters.
    words: Vec<String>,
}

impl Search {
    pub fn new(text: &str) -> Search {
        let text = clean(text.trim(), NAME);
        let words = text.split_whitespace().take(WORDS_MAX).map(str::to_lowercase).collect();
        Search { text, words }
    }

    pub fn text(&self) -> &str {
        &self.text
    }

    pub fn is_empty(&self) -> bool {
        self.words.is_empty()
    }

    pub fn finds(&self, row: &Row) -> bool {
        let cause = row.cause.as_ref();
        let texts = [
            row.id.as_str(),
            &row.name,
            &row.version,
            &row.config,
            row.state.as_str(),
            row.contact.as_str(),
            cause.map_or("", |it| &it.node),
            cause.map_or("", |it| &it.words),
        ];
        let texts = texts.map(str::to_lowercase);
        self.words.iter().all(|word| texts.iter().any(|text| text.contains(word)))
    }
}

impl<'de> Deserialize<'de> for Search {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Search, D::Error> {
        Ok(Search::new(&String::deserialize(deserializer)?))
    }
}

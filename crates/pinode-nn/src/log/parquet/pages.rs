//! Pages whose counts are believed only as far as their bytes reach: the library makes room for what they promise.

use ::parquet::basic::Encoding;
use ::parquet::column::page::{Page, PageMetadata, PageReader};
use ::parquet::errors::{ParquetError, Result};

/// The pages of a column, checked.
pub(super) struct Checked(pub Box<dyn PageReader>);

impl Iterator for Checked {
    type Item = Result<Page>;

    fn next(&mut self) -> Option<Self::Item> {
        self.get_next_page().transpose()
    }
}

impl PageReader for Checked {
    fn get_next_page(&mut self) -> Result<Option<Page>> {
        let page = self.0.get_next_page()?;
        if let Some(page) = &page {
            check(page)?;
        }
        Ok(page)
    }

    fn peek_next_page(&mut self) -> Result<Option<PageMetadata>> {
        self.0.peek_next_page()
    }

    fn skip_next_page(&mut self) -> Result<()> {
        self.0.skip_next_page()
    }
}

fn check(page: &Page) -> Result<()> {
    // Nothing takes less than a bit in a dictionary. Data pages cannot be judged by their bytes: a run of one value takes as many as
    // a single one; of them no more than a batch is unpacked at once.
    if let Page::DictionaryPage {
        buf, num_values, ..
    } = page
        && *num_values as usize > buf.len().saturating_mul(8)
    {
        return Err(ParquetError::General(format!(
            "a dictionary of {num_values} values in {} bytes",
            buf.len()
        )));
    }
    // Decoders of these make room for a count within the page, before they look at how long that is.
    match page.encoding() {
        encoding @ (Encoding::DELTA_LENGTH_BYTE_ARRAY | Encoding::DELTA_BYTE_ARRAY) => {
            Err(ParquetError::NYI(format!(
                "text in the encoding {encoding} is not read, write ids of runs as integers"
            )))
        }
        _ => Ok(()),
    }
}

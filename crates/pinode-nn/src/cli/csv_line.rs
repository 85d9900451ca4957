//! Lines of CSV files.

/// A line of a CSV file, its fields in quotation marks where they need to be.
pub(super) fn csv_line(fields: &[String]) -> Vec<u8> {
    let mut line = csv::Writer::from_writer(Vec::new());
    // Writing to memory does not fail.
    let _ = line.write_record(fields);
    line.into_inner().unwrap_or_default()
}

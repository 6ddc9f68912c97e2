//! Builds the book: `make book`.

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = hksl_tests::book::build()?;
    println!("{}", folder.join("index.html").display());
    Ok(())
}

//! PNG.

use png::{BitDepth, ColorType, Compression, Encoder, EncodingError};

use super::Picture;

impl Picture {
    /// As a PNG file with a title.
    ///
    /// # Errors
    /// Those of the encoder, for pictures without a pixel.
    pub fn to_png(&self, title: &str) -> Result<Vec<u8>, EncodingError> {
        let mut bytes = Vec::new();
        let mut encoder = Encoder::new(&mut bytes, self.width as u32, self.height as u32);
        encoder.set_color(ColorType::Rgba);
        encoder.set_depth(BitDepth::Eight);
        encoder.set_compression(Compression::Fast);
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
        encoder.add_itxt_chunk("Title".to_owned(), title.to_owned())?;
        encoder.add_text_chunk(
            "Software".to_owned(),
            concat!("chladni ", env!("CARGO_PKG_VERSION")).to_owned(),
        )?;
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&self.pixels)?;
        writer.finish()?;
        Ok(bytes)
    }
}

"""Colour of daylight: wavelengths, responses of the eye, spectra of sources and of surfaces.

Light in a band is stated as the illuminance [lx] of D65 light with the same spectral irradiance at
the band's wavelength. D65 light has the same number in all bands, and every response of the eye is
a weighted sum over bands whose weights add up to 1: illuminance, α-opic equivalent daylight
illuminances (CIE S 026), and tristimulus values per those of D65.

bands
    Wavelengths of a case, and the weights of the responses.
spectra, sources
    Spectra from files and constants; of the sky and of the sun.
tints
    Surfaces in a band: materials whose amounts are those of one wavelength.
melanopic
    Annual metrics of melanopic light at sensors and views, with their intervals.
appearance
    Temperature, distance from the locus, and rendition.
"""

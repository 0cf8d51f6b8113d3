#version 330 core
// The number of the triangle, from 1, as a 24-bit colour, red the least significant byte.

out vec4 frag_color;

void main()
{
    int number = gl_PrimitiveID + 1;
    ivec3 bytes = ivec3(number, number >> 8, number >> 16) & 255;
    frag_color = vec4(vec3(bytes) / 255.0, 1.0);
}
